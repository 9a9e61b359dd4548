// The table of actors: one row each, changed in place so that the focus and screen readers stay where they are.

import { duration, h, number, setText } from "./core/dom.js";

const MAX_ROWS = 200;
const rows = new Map();

/** What an actor's state is called, and how it stands. */
export function standing(actor) {
  if (!actor.alive) return ["gone", "fault"];
  if (actor.state.startsWith("acting") || actor.state.startsWith("evaluating")) return [actor.state, "good"];
  return [actor.state || "starting", /buffer is full|does not answer/.test(actor.state) ? "caution" : "busy"];
}

/** Show the actors; those that are gone or came again come first where there are more than fit. */
export function showActors(body, actors, watched, watch) {
  const shown = actors.length <= MAX_ROWS ? actors
    : [...actors].sort((a, b) => a.alive - b.alive || b.restarts - a.restarts).slice(0, MAX_ROWS);
  const names = new Set(shown.map(({ name }) => name));
  for (const [name, row] of rows) {
    if (names.has(name)) continue;
    row.remove();
    rows.delete(name);
  }
  shown.forEach((actor, i) => {
    if (!rows.has(actor.name)) rows.set(actor.name, makeRow(actor.name, watch));
    const row = rows.get(actor.name);
    if (body.children[i] !== row) body.insertBefore(row, body.children[i] ?? null);
    fill(row, actor, actor.name === watched);
  });
}

function makeRow(name, watch) {
  const cell = (kind = "") => h("td", { class: kind });
  const right = () => cell("right");
  return h("tr", { "data-actor": name },
    h("th", { scope: "row" }, name), h("td", { class: "state" }, h("span", { class: "badge" })),
    right(), right(), right(), right(), right(), right(), right(), right(), cell("error"), cell(),
    h("td", {}, h("button", { class: "quiet", onclick: () => watch(name), "aria-label": `Watch ${name}` }, "Watch")));
}

function fill(row, actor, watched) {
  const [word, tone] = standing(actor), cells = row.children, known = actor.version >= 0;
  row.className = actor.alive ? "" : "gone";
  row.setAttribute("aria-current", String(watched));
  const badge = cells[1].firstChild;
  badge.className = `badge ${tone}`;
  setText(badge, word);
  const texts = [
    number(actor.alive ? actor.steps_per_second : 0, "", 1), number(actor.steps, "", 0), number(actor.episodes, "", 0),
    known ? String(actor.version) : "–", known ? behind(actor) : "–", String(actor.buffered),
    actor.silent >= 0 ? `${duration(actor.silent)} ago` : "–", String(actor.restarts), actor.last_error, actor.host,
  ];
  texts.forEach((text, i) => setText(cells[i + 2], text));
  cells[6].classList.toggle("late", actor.lag > 20);
  cells[9].classList.toggle("late", actor.restarts > 0);
  cells[12].firstChild.disabled = !actor.alive;
  setText(cells[12].firstChild, watched ? "Watching" : "Watch");
}

function behind({ lag, lag_seconds: seconds }) {
  return lag ? `${lag} (${duration(seconds)})` : "0";
}
