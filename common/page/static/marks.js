// What is drawn on maps, on every page with the same shapes: units are metres with y up, and sizes come in metres too.

import { colour, h } from "./dom.js";

const SIGNS = {
  square: (c) => `<rect x="5" y="3" width="10" height="10" fill="${c}"/>`,
  dot: (c) => `<circle cx="10" cy="8" r="4" fill="${c}"/>`,
  dots: (c) => `<g fill="${c}"><circle cx="4" cy="10" r="1.6"/><circle cx="9" cy="6" r="1.6"/><circle cx="14" cy="8" r="1.6"/></g>`,
  line: (c) => `<path d="M2 12 8 5l10 4" fill="none" stroke="${c}" stroke-width="2.6"/>`,
  thin: (c) => `<path d="M2 12 9 4l9 6" fill="none" stroke="${c}" stroke-width="1.2"/>`,
  dashes: (c) => `<path d="M2 12 8 5l10 4" fill="none" stroke="${c}" stroke-width="2.6" stroke-dasharray="4 3"/>`,
  triangle: (c) => `<path d="M10 1 17 14H3z" fill="${c}"/>`,
  ring: (c) => `<circle cx="10" cy="8" r="5.5" fill="none" stroke="${c}" stroke-width="2.4"/>`,
  cross: (c) => `<path d="M5 3l10 10M15 3 5 13" stroke="${c}" stroke-width="2.4"/>`,
};

/** The sign of a meaning (common/palette.py) for a legend, such as sign("triangle", "beacon"). */
export function sign(shape, meaning) {
  const picture = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  picture.setAttribute("viewBox", "0 0 20 16");
  picture.setAttribute("aria-hidden", "true");
  picture.innerHTML = SIGNS[shape](`var(--${meaning})`);
  return picture;
}

/** One line of a legend. */
export function legendItem(shape, meaning, text) {
  return h("span", { class: "legend-item" }, sign(shape, meaning), text);
}

/** Positions in metres of a flat list of centimetres with so many numbers each. */
export function* places(flat, stride) {
  for (let i = 0; i + stride <= (flat?.length ?? 0); i += stride) yield [flat[i] / 100, flat[i + 1] / 100, flat[i + 2]];
}

export function line(context, points, stroke, width) {
  context.strokeStyle = stroke;
  context.lineWidth = width;
  context.lineJoin = context.lineCap = "round";
  context.beginPath();
  points.forEach(([x, y], i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.stroke();
}

export function disc(context, x, y, radius, fill, rim = null, width = 0) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.fillStyle = fill;
  context.fill();
  if (!rim) return;
  context.strokeStyle = rim;
  context.lineWidth = width;
  context.stroke();
}

export function ring(context, x, y, radius, stroke, width) {
  context.beginPath();
  context.arc(x, y, radius, 0, 2 * Math.PI);
  context.strokeStyle = stroke;
  context.lineWidth = width;
  context.stroke();
}

/** The viewpoint graph of flat lists: viewpoints x, y, kind (0 plain, 1 visited, 2 useful), edges x, y, x, y. */
export function graph(context, pixel, { edges = [], viewpoints = [] }) {
  context.strokeStyle = colour("edge");
  context.globalAlpha = 0.55;
  context.lineWidth = pixel;
  context.beginPath();
  for (let i = 0; i + 4 <= edges.length; i += 4) {
    context.moveTo(edges[i] / 100, edges[i + 1] / 100);
    context.lineTo(edges[i + 2] / 100, edges[i + 3] / 100);
  }
  context.stroke();
  context.globalAlpha = 1;
  const looks = [[colour("viewpoint"), 2.2], [colour("visited"), 2.2], [colour("useful"), 3.4]];
  for (const [x, y, kind] of places(viewpoints, 3)) {
    const [fill, radius] = looks[kind] ?? looks[0];
    disc(context, x, y, radius * pixel, fill);
  }
}

/** Frontier cells of so many centimetres, large enough to be seen. */
export function frontierCells(context, pixel, { frontiers, cell }) {
  context.fillStyle = colour("frontier");
  const size = Math.max(cell / 100, 2 * pixel);
  for (const [x, y] of places(frontiers, 2)) context.fillRect(x - size / 2, y - size / 2, size, size);
}

export function triangle(context, x, y, size, fill, pixel) {
  context.beginPath();
  context.moveTo(x, y + size);
  context.lineTo(x - 0.87 * size, y - 0.6 * size);
  context.lineTo(x + 0.87 * size, y - 0.6 * size);
  context.closePath();
  context.fillStyle = fill;
  context.fill();
  context.strokeStyle = colour("panel");
  context.lineWidth = 1.2 * pixel;
  context.stroke();
}
