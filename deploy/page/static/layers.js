// What is drawn on the map, in the order in which it is drawn: each layer has its name, its sign and its switch.

import { colour, h } from "./core/dom.js";
import { disc, frontierCells, graph, line, places, ring, sign, triangle } from "./core/marks.js";

const KEY = "hd-page-layers";
const LAYERS = [
  { name: "scan", label: "scan", sign: "dots", colour: "scan", draw: drawScan },
  { name: "graph", label: "viewpoint graph", sign: "thin", colour: "viewpoint", draw: drawGraph },
  { name: "frontiers", label: "frontiers", sign: "square", colour: "frontier", draw: drawFrontiers },
  { name: "way", label: "driven way", sign: "line", colour: "way", draw: drawWay },
  { name: "path", label: "chosen path", sign: "dashes", colour: "waypoint", draw: drawPath },
  { name: "beacons", label: "beacons, probability", sign: "triangle", colour: "beacon", draw: drawBeacons },
  { name: "banned", label: "left alone", sign: "cross", colour: "banned", draw: drawBanned },
];

/** The switches, which are the legend too. */
export class Layers {
  constructor(place, onChange) {
    this.hidden = new Set(JSON.parse(localStorage.getItem(KEY) ?? "[]"));
    const list = LAYERS.map(({ name, label, sign: shape, colour: meaning }) => {
      const box = h("input", { type: "checkbox", checked: !this.hidden.has(name), onchange: () => {
        if (box.checked) this.hidden.delete(name);
        else this.hidden.add(name);
        localStorage.setItem(KEY, JSON.stringify([...this.hidden]));
        onChange();
      }, onkeydown: (event) => {
        // The space bar stops the robot.
        if (event.key === "Enter") box.click();
      } });
      return h("label", {}, box, sign(shape, meaning), label);
    });
    const fold = h("details", {}, h("summary", {}, "Layers"), ...list);
    fold.addEventListener("toggle", onChange);
    fold.open = matchMedia("(min-width: 821px)").matches;
    place.append(fold);
  }

  draw(context, view, robot) {
    for (const layer of LAYERS) {
      if (this.hidden.has(layer.name)) continue;
      context.save();
      layer.draw(context, view, robot);
      context.restore();
    }
    drawPlaces(context, view, robot);
  }
}

function drawScan(context, view, { scan }) {
  context.fillStyle = colour("scan");
  const size = Math.max(2.6 * view.pixel, 0.05);
  for (const [x, y] of places(scan, 2)) context.fillRect(x - size / 2, y - size / 2, size, size);
}

function drawGraph(context, view, { scene }) {
  if (scene) graph(context, view.pixel, scene);
}

function drawFrontiers(context, view, { scene }) {
  if (scene) frontierCells(context, view.pixel, scene);
}

function drawWay(context, view, { way, pose }) {
  if (!way?.length) return;
  line(context, [...way, ...(pose ? [pose] : [])], colour("way"), 2.4 * view.pixel);
}

function drawPath(context, view, { path, pose, status }) {
  if (!path?.length || !pose) return;
  context.setLineDash([7 * view.pixel, 5 * view.pixel]);
  line(context, [pose, ...places(path, 2)], colour("waypoint"), 2.6 * view.pixel);
  context.setLineDash([]);
  if (status?.waypoint) disc(context, ...status.waypoint, 5.5 * view.pixel, colour("waypoint"), colour("panel"), 1.5 * view.pixel);
}

function drawBeacons(context, view, { scene, status }) {
  if (!scene) return;
  const chosen = status?.beacon;
  for (const [x, y, thousandths] of places(scene.waypoints, 3)) {
    context.globalAlpha = 0.15 + 0.85 * Math.max(thousandths, 0) / 1000;
    ring(context, x, y, 6 * view.pixel, colour("waypoint"), 2 * view.pixel);
  }
  context.globalAlpha = 1;
  for (const [x, y, thousandths] of places(scene.beacons, 3)) {
    const share = Math.max(thousandths, 0) / 1000;
    triangle(context, x, y, (7 + 7 * Math.sqrt(share)) * view.pixel, colour("beacon"), view.pixel);
    if (thousandths >= 50) words(context, view, x, y, `${Math.round(thousandths / 10)} %`, 13);
  }
  if (chosen) {
    triangle(context, ...chosen, 9 * view.pixel, colour("beacon"), view.pixel);
    ring(context, ...chosen, 15 * view.pixel, colour("beacon"), 2 * view.pixel);
  }
}

function drawBanned(context, view, { scene }) {
  if (!scene) return;
  context.strokeStyle = colour("banned");
  context.lineWidth = 2.4 * view.pixel;
  const arm = 6 * view.pixel;
  context.beginPath();
  for (const [x, y] of places(scene.banned, 2)) {
    context.moveTo(x - arm, y - arm);
    context.lineTo(x + arm, y + arm);
    context.moveTo(x - arm, y + arm);
    context.lineTo(x + arm, y - arm);
  }
  context.stroke();
}

/** Home, target and the robot itself: they cannot be switched off. */
function drawPlaces(context, view, { status, pose }) {
  const { pixel } = view;
  if (status?.home) {
    const [x, y] = status.home, size = 6 * pixel;
    context.strokeStyle = colour("text");
    context.lineWidth = 1.6 * pixel;
    context.strokeRect(x - size, y - size, 2 * size, 2 * size);
  }
  if (status?.target) {
    ring(context, ...status.target, 11 * pixel, colour("target"), 3 * pixel);
    disc(context, ...status.target, 3.5 * pixel, colour("target"));
  }
  if (!pose) return;
  const [x, y, yaw] = pose, radius = Math.max(10 * pixel, 0.25);
  disc(context, x, y, radius, colour("robot"), colour("panel"), 2.2 * pixel);
  context.fillStyle = colour("panel");
  context.beginPath();
  context.moveTo(x + radius * 0.82 * Math.cos(yaw), y + radius * 0.82 * Math.sin(yaw));
  context.lineTo(x + radius * 0.5 * Math.cos(yaw + 2.3), y + radius * 0.5 * Math.sin(yaw + 2.3));
  context.lineTo(x + radius * 0.5 * Math.cos(yaw - 2.3), y + radius * 0.5 * Math.sin(yaw - 2.3));
  context.fill();
}

/** The place that was clicked. */
export function drawPin(context, view, [x, y]) {
  const { pixel } = view;
  ring(context, x, y, 9 * pixel, colour("text"), 2.5 * pixel);
  disc(context, x, y, 3 * pixel, colour("text"));
}

/** Words beside a place, upright although y points up. */
function words(context, view, x, y, text, aside) {
  context.save();
  context.translate(x, y);
  context.scale(view.pixel, -view.pixel);
  context.font = "600 12px system-ui, sans-serif";
  context.textBaseline = "middle";
  context.lineWidth = 3.5;
  context.lineJoin = "round";
  context.strokeStyle = colour("panel");
  context.fillStyle = colour("beacon");
  context.strokeText(text, aside, 0);
  context.fillText(text, aside, 0);
  context.restore();
}
