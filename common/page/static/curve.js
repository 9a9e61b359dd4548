// Curves by uPlot in the colours of the page.

import uPlot from "./vendor/uPlot.esm.js";
import { colour, number, onScheme } from "./dom.js";

/** A curve over x, which keeps the width of its element. */
export class Curve {
  /**
   * @param {HTMLElement} place
   * @param {{label: string, unit: string, x: {label: string, unit: string, time?: boolean},
   *   lines: {label: string, colour: string, width?: number, points?: boolean}[], height?: number}} how
   *
   * The legend tells the values under the pointer, and the newest ones without it.
   */
  constructor(place, how) {
    this.place = place;
    this.how = how;
    this.data = [[], ...how.lines.map(() => [])];
    this._make();
    new ResizeObserver(() => this._resize()).observe(place);
    onScheme(() => this._make());
  }

  /** Show [xs, ys, ...], one array of numbers (or null) for each line. */
  set(data) {
    this.data = data;
    this.plot.setData(data);
  }

  _make() {
    this.plot?.destroy();
    const { how } = this;
    const axis = { stroke: colour("text-quiet"), grid: { stroke: colour("rule"), width: 1 }, ticks: { stroke: colour("rule"), width: 1 }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    this.plot = new uPlot(
      {
        width: Math.max(this.place.clientWidth, 120),
        height: how.height ?? 180,
        cursor: { points: { size: 7 } },
        legend: { show: how.lines.length > 1 || how.legend === true },
        scales: { x: { time: how.x.time ?? false }, ...(how.y ? { y: how.y } : {}) },
        axes: [
          { ...axis, label: `${how.x.label}${how.x.unit ? ` (${how.x.unit})` : ""}`, labelSize: 18, size: 34 },
          { ...axis, label: `${how.label}${how.unit ? ` (${how.unit})` : ""}`, labelSize: 18, size: (plot, texts) => Math.max(50, 20 + 7 * Math.max(...(texts ?? []).map((text) => text.length))) },
        ],
        series: [
          { label: how.x.label, value: (plot, x) => number(x ?? plot.data[0].at(-1), how.x.unit, how.x.unit ? 1 : 0) },
          ...how.lines.map((line) => ({
            label: line.label,
            value: (plot, y, i) => short(y ?? plot.data[i].findLast((each) => each !== null), how.unit),
            stroke: colour(line.colour),
            width: line.width ?? 2,
            points: { show: line.points ?? false, size: 5, fill: colour(line.colour) },
            spanGaps: true,
          })),
        ],
      },
      this.data,
      this.place,
    );
  }

  _resize() {
    const width = this.place.clientWidth;
    if (width > 0 && width !== this.plot.width) this.plot.setSize({ width, height: this.how.height ?? 180 });
  }
}

/** A value with three digits or more, and its unit. */
function short(value, unit) {
  const size = Math.abs(value ?? 0);
  if (size && size < 0.001) return `${value.toExponential(1)}${unit ? `\u202f${unit}` : ""}`;
  return number(value, unit, size >= 100 || !size ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}
