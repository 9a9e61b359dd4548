// The page of a training: it shows what the learner and its actors tell, and passes commands on.

import { Connection } from "./core/connection.js";
import { ask, count, duration, facts, h, number, onScheme, setText } from "./core/dom.js";
import { MapView } from "./core/map.js";
import { attachShell, carryOut } from "./core/shell.js";
import { TilePicture } from "./core/tiles.js";
import { showActors } from "./actors.js";
import { drawEpisode, episodeLegend } from "./episode.js";
import { forgetPictures, repaintWorlds, showWorlds, takeWorldTiles, takeWorldView } from "./evaluations.js";
import { Plots } from "./plots.js";

const BASE = ["run", "status", "actors", "curve-*", "evaluations", "world/*"];
const TONES = { training: "busy", cloning: "busy", complete: "good", collecting: "busy", waiting: "caution", paused: "caution", stopping: "caution", "disk full": "fault", held: "fault" };
const WORDS = {
  collecting: "collecting the first experience", waiting: "waiting for experience: no actor delivers enough",
  cloning: "imitating the expert", "disk full": "the disk is full: training waits for room", held: "another learner of this run is at work",
};
const $ = (id) => document.getElementById(id);

const connection = new Connection(BASE);
attachShell(connection, $("tools"));

let watched = new URLSearchParams(location.search).get("actor") ?? "";
let chosen = Boolean(watched);
let visible = true;
// By actor: one that is looked at again is sent only what changed since.
const pictures = new Map();
// The buttons lie on the right.
const map = new MapView($("map"), drawMap, () => {}, () => ({ left: 0, right: 46, low: 0 }));
const plots = new Plots($);
$("legend").append(...episodeLegend());

const value = (name) => connection.values.get(name);
const actors = () => value("actors") ?? [];
const picture = () => pictures.get(watched);
const view = () => value(`actor/${watched}/view`);

// ---- what comes

connection.on("hello", () => {
  pictures.clear();
  forgetPictures();
});
connection.on("gone", (name) => {
  const [kind, actor, what] = name.split("/");
  if (kind === "actor" && what === "belief") pictures.delete(actor);
});
connection.on("tiles", (frame) => {
  const [kind, name] = frame.name.split("/");
  if (kind === "world") takeWorldTiles(Number(name), frame);
  else {
    if (!pictures.has(name)) pictures.set(name, new TilePicture());
    pictures.get(name).take(frame);
    if (name === watched) fit();
  }
});
connection.on("values", (name, found) => {
  const [kind, id, what] = name.split("/");
  if (name === "evaluations") showEvaluations(found);
  else if (name === "curve-tags") plots.setTags(found);
  else if (kind === "world" && what === "view") takeWorldView(Number(id), found);
});
connection.on("series", (name, items) => {
  if (name === "curve-points") plots.setRows(items);
});
connection.onNews(() => showAll());
connection.on("state", () => showAll());
onScheme(() => {
  for (const each of pictures.values()) each.repaint();
  map.redraw();
  repaintWorlds();
});

// ---- what is shown

function showAll() {
  const status = value("status"), run = value("run");
  showDeck(status, run);
  if (status) showTiles(status);
  showTable();
  showEpisode();
  map.redraw();
}

function showDeck(status, run) {
  let tone = TONES[status?.state] ?? "", word = status?.state ?? "", reason = status ? progress(status) : "";
  if (!connection.open) [tone, word, reason] = ["fault", "Not connected", connection.why || "the page's process does not answer; the training may continue"];
  else if (run?.problem) [tone, word, reason] = ["fault", "No answer", run.silent ? `the learner is silent for ${duration(run.silent)}; it was ${status?.state ?? "unknown"}` : run.problem];
  else if (!status) [word, reason] = ["Waiting", "the learner has not told its status yet"];
  $("deck").className = `deck ${tone}`;
  setText($("state"), word);
  setText($("reason"), reason);
  setText($("run"), run?.name ?? "");
  const share = status ? Math.min((100 * status.updates) / status.total_updates, 100) : 0;
  $("progress").firstChild.style.width = `${share}%`;
  $("progress").setAttribute("aria-valuenow", share.toFixed(1));
  const paused = status?.state === "paused", over = !connection.open || !status || run?.problem || ["complete", "stopping"].includes(status.state);
  setText($("pause"), paused ? "Resume" : "Pause");
  for (const id of ["pause", "checkpoint", "stop"]) $(id).disabled = over;
  document.title = `${word || "Training"}${status ? ` · ${Math.floor(share)} %` : ""} · ${run?.name ?? "HDPlanner"}`;
}

function progress(status) {
  const left = (status.total_updates - status.updates) / status.updates_per_second;
  const parts = [`${number(status.updates, "", 0)} of ${number(status.total_updates, "", 0)} updates`];
  if (status.updates_per_second > 0 && left > 0) parts.push(`about ${duration(left)} to go`);
  if (WORDS[status.state]) parts.unshift(WORDS[status.state]);
  return parts.join(" · ");
}

/** [name, value, note, share or null, whether the note is a caution] */
function figures(status) {
  const best = status.best_figures, off = status.ratio_actual / status.ratio_declared;
  const alive = actors().filter((each) => each.alive), { actor: acting, evaluator: evaluators } = value("run").alive;
  const lags = alive.filter((each) => each.version >= 0).map((each) => each.lag);
  return [
    ["Updates", number(status.updates_per_second, "/s", 2), `${number(status.updates, "", 0)} so far`],
    ["Steps collected", number(status.steps_per_second, "/s", 1), `${number(status.steps, "", 0)} in ${number(status.episodes, "", 0)} episodes`],
    ["Replay", number(100 * status.replay_fill, "%", 0), `${number(status.replay, "", 0)} steps, ${number(status.replay_bytes / 1e6, "MB", 0)}`, status.replay_fill],
    ["Updates per step", status.ratio_actual.toPrecision(3), status.hold ? `actors wait ${number(status.hold, "s", 1)}` : `declared ${Number(status.ratio_declared.toPrecision(4))}`, null, status.hold > 0 || (status.updates > 100 && off < 0.8)],
    ["Best policy", status.best >= 0 ? number(best.distance, "m", 1) : "none yet", status.best >= 0 ? `version ${status.best}, ${number(100 * best.success, "%", 0)} complete` : "no evaluation is complete"],
    ["Newest policy", `version ${Math.max(status.version, 0)}`, lags.length ? `actors up to ${Math.max(...lags)} behind` : ""],
    ["Actors", `${acting} alive`, `${count(evaluators, "evaluator")} besides`],
    ["Checkpoint", status.last_checkpoint ? `at ${number(Number(status.last_checkpoint), "", 0)}` : "none yet", `next in ${duration(Math.max(status.next_checkpoint, 0))}`],
  ];
}

function showTiles(status) {
  const found = figures(status), place = $("tiles");
  if (!place.children.length) {
    place.append(...found.map(([name, , , share]) => h("div", { class: "tile", "data-figure": name }, h("p", { class: "name" }, name), h("p", { class: "value" }), h("p", { class: "note" }),
      share === undefined || share === null ? null : h("div", { class: "share", "aria-hidden": "true" }, h("i", {})))));
  }
  found.forEach(([, text, note, share, caution], i) => {
    const tile = place.children[i].children;
    setText(tile[1], text);
    setText(tile[2], note);
    tile[2].classList.toggle("caution", Boolean(caution));
    if (tile[3]) tile[3].firstChild.style.width = `${100 * share}%`;
  });
}

function showTable() {
  const known = actors(), alive = known.filter((each) => each.alive);
  if (!chosen && !alive.some(({ name }) => name === watched)) choose((alive.find(({ role }) => role === "actor") ?? alive[0])?.name ?? watched, false);
  const { alive: roles = { actor: 0, evaluator: 0 }, gone = 0 } = value("run") ?? {};
  setText($("actors-title"), `Actors: ${roles.actor} alive${roles.evaluator ? `, ${count(roles.evaluator, "evaluator")}` : ""}${gone ? `, ${gone} gone` : ""}`);
  $("no-actors").hidden = known.length > 0 || !value("status");
  showActors($("actors"), known, watched, (name) => choose(name, true));
  const signature = known.map(({ name, alive: here }) => `${name}${here}`).join();
  if ($("watched").dataset.signature !== signature) {
    $("watched").dataset.signature = signature;
    $("watched").replaceChildren(...known.map(({ name, role, alive: here }) => h("option", { value: name }, `${name}${role === "evaluator" ? ", evaluates" : ""}${here ? "" : " (gone)"}`)));
  }
  if ($("watched").value !== watched) $("watched").value = watched;
}

function showEpisode() {
  const seen = view(), actor = actors().find(({ name }) => name === watched);
  $("waiting").hidden = Boolean(seen);
  setText($("waiting"), !watched ? "no actor to watch yet" : actor?.alive ? "waiting for the actor's next decision" : "this actor is gone");
  facts($("episode"), seen ? [
    ["World", seen.world], ["Task", seen.task],
    ["Decisions", number(seen.step, "", 0)], ["Driven", number(seen.distance, "m", 1)],
    ["Seen", number(100 * seen.explored, "%", 1)], ["Beacons", String(seen.beacons.length / 2)],
    ["Driver", seen.version >= 0 ? `${seen.driver}, version ${seen.version}` : seen.driver],
    ["Episode", seen.ended ? (seen.success ? "complete" : "ended") : "running", seen.ended ? (seen.success ? "good" : "caution") : "busy"],
  ] : []);
}

function showEvaluations(worlds) {
  showWorlds($("worlds"), worlds);
  $("no-worlds").hidden = worlds.length > 0;
  const newest = worlds.map(({ results }) => results.at(-1)), version = Math.max(...newest.map(([of]) => of));
  const of = newest.filter((each) => each[0] === version), done = of.filter((each) => each[1]).length;
  setText($("evaluation-text"), worlds.length ? `version ${version}: ${done} of ${of.length} worlds complete, mean ${number(of.reduce((sum, each) => sum + each[2], 0) / of.length, "m", 1)}` : "");
}

// ---- the map

/** Keep all that is known in sight. */
function fit() {
  if (picture()?.box) map.fit(picture().box);
  map.redraw();
}

function drawMap(context, shown) {
  if (picture()) drawEpisode(context, shown.pixel, picture(), view());
  const { metres, pixels } = shown.bar(80);
  setText($("scale-text"), metres < 1 ? `${metres * 100}\u202fcm` : `${metres}\u202fm`);
  $("scale-bar").style.width = `${pixels}px`;
  const seen = view();
  $("map").setAttribute("aria-label", seen ? `Map of what ${watched} knows: ${number(100 * seen.explored, "%", 0)} of ${seen.world} seen, ${seen.beacons.length / 2} beacons` : "Map of what the actor knows");
}

function choose(name, byHand) {
  chosen = chosen || byHand;
  if (name === watched) return;
  watched = name;
  map.follow();
  fit();
  look();
  showAll();
}

/** Ask for the episode only while it is on the screen: the actor pays for it. */
function look() {
  const looks = watched && visible && document.visibilityState === "visible";
  connection.watch(looks ? [...BASE, `actor/${watched}/*`] : BASE);
}

$("watched").addEventListener("change", (event) => choose(event.target.value, true));
$("zoom-in").addEventListener("click", () => map.zoom(1.3));
$("zoom-out").addEventListener("click", () => map.zoom(1 / 1.3));
$("fit").addEventListener("click", () => map.follow());
document.addEventListener("visibilitychange", look);
new IntersectionObserver(([entry]) => {
  if (entry.isIntersecting === visible) return;
  visible = entry.isIntersecting;
  look();
}).observe($("live"));

// ---- commands

$("pause").addEventListener("click", () => {
  const paused = value("status")?.state === "paused";
  carryOut(connection, "", paused ? "resume" : "pause", {}, paused ? "The training continues" : "The training waits, and its actors with it");
});
$("checkpoint").addEventListener("click", () => carryOut(connection, "", "checkpoint", {}, "The checkpoint is written"));
$("stop").addEventListener("click", async () => {
  const { name } = value("run");
  const sure = await ask({ title: "Stop the training", text: `The learner writes a checkpoint and ends, and its own actors with it. "hd-learner resume --run ${name}" continues from there.`, confirm: "Stop", kind: "fault" });
  if (sure) await carryOut(connection, "", "stop", {}, "The training stops");
});
setInterval(() => connection.open && showDeck(value("status"), value("run")), 1000);
