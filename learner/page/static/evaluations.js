// Evaluation world by world: the newest episode there as a picture, and how far every version drove.

import { h, number, setText } from "./core/dom.js";
import { TilePicture } from "./core/tiles.js";
import { drawEpisode } from "./episode.js";

const cards = new Map();
const BARS = 24;

/** Show the worlds; each card is made once and changed in place. */
export function showWorlds(list, worlds) {
  const known = new Set(worlds.map(({ id }) => id));
  for (const [id, card] of cards) {
    if (known.has(id)) continue;
    card.element.remove();
    cards.delete(id);
  }
  for (const world of worlds) {
    if (!cards.has(world.id)) {
      cards.set(world.id, new Card());
      list.append(cards.get(world.id).element);
    }
    cards.get(world.id).show(world);
  }
}

/** Everything comes anew, since the connection is a new one. */
export const forgetPictures = () => cards.forEach((card) => card.picture.clear());
export const takeWorldTiles = (id, frame) => cards.get(id)?.take(frame);
export const takeWorldView = (id, view) => cards.get(id)?.see(view);
export const repaintWorlds = () => cards.forEach((card) => card.repaint());

class Card {
  constructor() {
    this.picture = new TilePicture();
    this.view = null;
    this.canvas = h("canvas", { role: "img" });
    this.name = h("p", { class: "name" });
    this.result = h("p", {}, h("span", { class: "badge" }));
    this.more = h("p", { class: "quiet-text" });
    this.bars = h("div", { class: "results", "aria-hidden": "true" });
    this.element = h("li", { class: "world" }, this.canvas, h("div", { class: "text" }, this.name, this.result, this.more, this.bars));
    new ResizeObserver(() => this.redraw()).observe(this.canvas);
  }

  show({ world, task, family, results, seen }) {
    const [version, success, distance, explored] = results.at(-1);
    this.element.dataset.world = world;
    setText(this.name, world);
    const badge = this.result.firstChild;
    badge.className = `badge ${success ? "good" : "caution"}`;
    setText(badge, `${success ? "complete" : "not complete"}, ${number(distance, "m", 1)}`);
    setText(this.more, `version ${version} · ${task}${family === "worlds" ? "" : `, ${family}`} · ${number(100 * explored, "%", 1)} seen`);
    const shown = results.slice(-BARS), longest = Math.max(...shown.map((each) => each[2]), 1);
    this.bars.replaceChildren(...shown.map(([of, done, metres]) => {
      const bar = h("i", { class: done ? "" : "missed", title: `version ${of}: ${number(metres, "m", 1)}${done ? "" : ", not complete"}` });
      bar.style.height = `${Math.round((24 * metres) / longest)}px`;
      return bar;
    }));
    this.canvas.hidden = !seen;
    this.canvas.setAttribute("aria-label", `${world}: the way that version ${version} drove, ${number(distance, "m", 1)}`);
  }

  take(frame) {
    this.picture.take(frame);
    this.redraw();
  }

  see(view) {
    this.view = view;
    this.redraw();
  }

  repaint() {
    this.picture.repaint();
    this.redraw();
  }

  redraw() {
    if (this.due) return;
    this.due = requestAnimationFrame(() => {
      this.due = 0;
      this.paint();
    });
  }

  paint() {
    const { canvas, picture } = this, ratio = devicePixelRatio || 1;
    canvas.width = Math.round(canvas.clientWidth * ratio);
    canvas.height = Math.round(canvas.clientHeight * ratio);
    if (!picture.box || !canvas.width || !canvas.height) return;
    const [left, low, right, high] = picture.box;
    const scale = 0.94 * Math.min(canvas.width / (right - left), canvas.height / (high - low));
    const context = canvas.getContext("2d");
    context.setTransform(scale, 0, 0, -scale, canvas.width / 2 - ((left + right) / 2) * scale, canvas.height / 2 + ((low + high) / 2) * scale);
    drawEpisode(context, ratio / scale, picture, this.view, false);
    // A world is looked at again after minutes: its tiles' canvases are not worth their memory.
    for (const tile of picture.tiles.values()) [tile.canvas, tile.stale] = [null, true];
  }
}
