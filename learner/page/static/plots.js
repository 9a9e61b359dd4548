// The curves: rows of [time, updates, a value for each tag] as columns for uPlot.

import { Curve } from "./core/curve.js";
import { h } from "./core/dom.js";

const COLOURS = ["curve", "frontier", "scan", "waypoint", "way", "useful"];
const UNITS = [
  ["entropy/", "nats"], ["temperature/", "reward/nat"], ["value/", "reward"], ["advantage/", "reward"],
  ["loss/", ""], ["gradient/", ""], ["cloning/", ""], ["policy/", ""],
];
const LOSSES = "loss/*";

export class Plots {
  /** @param {(id: string) => HTMLElement} find an element by its id */
  constructor(find) {
    this.find = find;
    this.tags = [];
    this.rows = [];
    this.over = "updates";
    this.figure = LOSSES;
    this.choice = find("figure");
    this.choice.addEventListener("change", () => {
      this.figure = this.choice.value;
      this.makeFigure();
      this.draw();
    });
    for (const over of ["updates", "minutes"]) find(`over-${over}`).addEventListener("click", () => this.turn(over));
    this.make();
  }

  setTags(tags) {
    const before = this.algorithmTags().join();
    this.tags = tags;
    const names = this.algorithmTags();
    if (names.join() === before) return;
    const options = [LOSSES, ...names].map((tag) => h("option", { value: tag }, tag === LOSSES ? "all losses" : tag));
    this.choice.replaceChildren(...options);
    this.choice.value = this.figure;
    this.makeFigure();
  }

  setRows(rows) {
    this.rows = rows;
    this.draw();
  }

  turn(over) {
    this.over = over;
    for (const each of ["updates", "minutes"]) this.find(`over-${each}`).setAttribute("aria-pressed", String(each === over));
    this.make();
    this.draw();
  }

  algorithmTags() {
    return this.tags.filter((tag) => UNITS.some(([beginning]) => tag.startsWith(beginning)) && tag !== "policy/version").sort();
  }

  make() {
    const metres = [
      { tag: "episode_train/distance", label: "training", colour: "curve-behind" },
      { tag: "evaluation/distance", label: "evaluation", colour: "curve", points: true },
    ];
    this.distance = this.curve("plot-distance", "distance", "m", metres);
    const share = metres.map((line) => ({ ...line, tag: line.tag.replace("distance", "success") }));
    this.success = this.curve("plot-success", "completed", "%", share, { range: [-2, 102] });
    this.speed = this.curve("plot-speed", "speed", "1/s", [
      { tag: "time/updates_per_second", label: "updates", colour: "curve" },
      { tag: "collect/steps_per_second", label: "steps collected", colour: "frontier" },
    ]);
    this.makeFigure();
  }

  makeFigure() {
    const tags = this.figure === LOSSES ? this.algorithmTags().filter((tag) => tag.startsWith("loss/")) : [this.figure];
    const lines = tags.slice(0, COLOURS.length).map((tag, i) => ({ tag, label: tag, colour: COLOURS[i] }));
    const [, unit] = UNITS.find(([beginning]) => this.figure.startsWith(beginning)) ?? ["", ""];
    this.figures = this.curve("plot-figure", this.figure === LOSSES ? "loss" : this.figure, unit, lines.length ? lines : [{ tag: "", label: "loss", colour: "curve" }]);
  }

  curve(id, label, unit, lines, y = null) {
    const place = this.find(id);
    place.replaceChildren();
    place.setAttribute("aria-label", `Curve of ${label}${unit ? ` in ${unit}` : ""}: ${lines.map((line) => line.label).join(", ")}`);
    const x = { label: this.over, unit: this.over === "minutes" ? "min" : "" };
    const made = new Curve(place, { label, unit, x: { label: x.label === "minutes" ? "time" : "updates", unit: x.unit }, lines, height: 190, legend: true, ...(y ? { y } : {}) });
    return { made, lines, factor: unit === "%" ? 100 : 1 };
  }

  draw() {
    const { rows } = this;
    this.find("no-curves").hidden = rows.length > 1;
    if (!rows.length) return;
    const began = rows[0][0];
    const xs = this.over === "updates" ? rows.map((row) => row[1]) : rows.map((row) => (row[0] - began) / 60);
    // Two points of one update (a round of evaluation between two others) stand beside each other; uPlot wants an order.
    for (let i = 1; i < xs.length; i++) if (xs[i] < xs[i - 1]) xs[i] = xs[i - 1];
    for (const { made, lines, factor } of [this.distance, this.success, this.figures, this.speed]) {
      made.set([xs, ...lines.map(({ tag }) => {
        const at = this.tags.indexOf(tag) + 2;
        return rows.map((row) => (at < 2 || row[at] === undefined || row[at] === null ? null : row[at] * factor));
      })]);
    }
  }
}
