// The page of robots: it shows what their bridges tell, and passes commands on.

import { Connection } from "./core/connection.js";
import { Curve } from "./core/curve.js";
import { ask, duration, h, notice, number, onScheme, rgb, setText } from "./core/dom.js";
import { MapView } from "./core/map.js";
import { attachShell, carryOut } from "./core/shell.js";
import { FREE, TilePicture } from "./core/tiles.js";
import { Layers, drawPin } from "./layers.js";
import { showEvents, showFaults, showInputs, showPlanner, showTask, showWatchdog } from "./panels.js";

const TONES = { running: "busy", returning: "busy", finished: "good", holding: "caution", paused: "caution", aborted: "caution", failed: "fault" };
const MOVING = new Set(["running", "returning", "holding"]);
const SPEEDS = [1, 2, 5, 10, 30];
const $ = (id) => document.getElementById(id);

const connection = new Connection(["robots", "replay", "robot/*"]);
attachShell(connection, $("tools"));

let selected = new URLSearchParams(location.search).get("robot") ?? "";
let pin = null;
const beliefs = new Map();
const layers = new Layers($("layers"), () => map.redraw());
const map = new MapView($("map"), drawMap, clickMap, () => {
  // On a phone the map needs the whole width.
  const wide = $("map").clientWidth > 700;
  const low = $("replay").hidden ? 0 : $("replay").offsetHeight + 52;
  return { left: wide ? $("layers").offsetWidth + 12 : 0, right: wide ? 56 : 0, low };
});
const decisions = new Curve($("decisions"), {
  label: "decision", unit: "ms", height: 130, x: { label: "time", unit: "", time: true },
  lines: [{ label: "decision", colour: "curve", width: 1.5 }],
});

const value = (name) => connection.values.get(`robot/${selected}/${name}`);
const series = (name) => connection.series.get(`robot/${selected}/${name}`)?.items;
const robots = () => connection.values.get("robots") ?? [];
const belief = () => beliefs.get(selected);
const current = () => robots().find((each) => each.name === selected);
const replaying = () => connection.values.has("replay");

// ---- what comes

connection.on("hello", () => beliefs.clear());
connection.on("tiles", (frame) => {
  const name = frame.name.split("/")[1];
  if (!beliefs.has(name)) beliefs.set(name, new TilePicture());
  beliefs.get(name).take(frame);
});
connection.on("gone", (channel) => {
  const [, name, what] = channel.split("/");
  if (what === "belief") beliefs.delete(name);
});
connection.on("value:robots", (known) => {
  if (!known.some((each) => each.name === selected) && known.length) select(known[0].name);
});
connection.on("series", (name, items) => {
  if (name === `robot/${selected}/decisions`) showDecisions(items);
  if (name === `robot/${selected}/events`) showEvents($("events"), items);
});
connection.on("state", () => showAll());
connection.onNews(() => showAll());
onScheme(() => {
  for (const picture of beliefs.values()) picture.repaint();
  map.redraw();
});

// ---- what is shown

function showAll() {
  const status = value("status");
  showTabs();
  showDeck(status);
  showButtons(status);
  showReplay();
  showFaults($("faults"), status);
  showTask($("task"), status);
  showPlanner($("planner"), status);
  showWatchdog($("watchdog"), status, value("watchdog"), value("pose"));
  showInputs($("inputs"), status);
  setText($("hint"), hint(status));
  if (belief()?.box) map.fit(belief().box);
  map.redraw();
}

function showDeck(status) {
  const silent = current()?.silent;
  let tone = TONES[status?.state] ?? "", word = status?.state ?? "", reason = status?.reason ?? "";
  if (!connection.open) [tone, word, reason] = ["fault", "Not connected", connection.why || "the page's process does not answer; the robot continues"];
  else if (!status) [tone, word, reason] = ["", "Waiting", "no robot has told its status yet"];
  else if (silent) [tone, word, reason] = ["fault", "No signal", `last: ${status.state}, ${status.reason}`];
  else if (status.emergency_stop) [tone, word, reason] = ["stopped", "Stopped", status.gate_reason || status.reason];
  $("deck").className = `deck ${tone}`;
  setText($("state"), word.charAt(0).toUpperCase() + word.slice(1));
  setText($("reason"), reason);
  const stopped = status?.emergency_stop === true, several = robots().length > 1;
  setText($("stop-word"), stopped ? "STOPPED" : several ? "STOP ALL" : "STOP");
  setText($("stop-what"), stopped ? "latched: press to stop again" : several ? `${robots().length} robots · Space or Esc` : "Space or Esc");
  $("stop").setAttribute("aria-label", several ? "Emergency stop of all robots" : "Emergency stop");
  $("stop").hidden = replaying();
  $("release").hidden = !stopped || replaying();
  document.title = `${$("state").textContent || "Robots"}${selected ? ` · ${selected}` : ""} · HDPlanner`;
}

function showTabs() {
  const known = robots();
  const signature = known.map(({ name }) => name).join(" ");
  if ($("tabs").dataset.signature !== signature) {
    $("tabs").dataset.signature = signature;
    $("tabs").replaceChildren(...known.map(({ name }) =>
      h("button", { role: "tab", "data-name": name, onclick: () => select(name) }, h("span", {}, name), h("span", { class: "badge" }))));
  }
  for (const tab of $("tabs").children) {
    const status = connection.values.get(`robot/${tab.dataset.name}/status`);
    const silent = !connection.open || known.find(({ name }) => name === tab.dataset.name)?.silent;
    tab.setAttribute("aria-selected", String(tab.dataset.name === selected));
    const stopped = status?.emergency_stop;
    tab.lastChild.className = `badge ${silent || stopped ? "fault" : TONES[status?.state] ?? ""}`;
    setText(tab.lastChild, silent ? "no signal" : stopped ? "stopped" : status?.state ?? "");
  }
}

function showDecisions(items) {
  const shown = items.slice(-400);
  decisions.set([shown.map(([at]) => at), shown.map(([, seconds]) => seconds * 1000)]);
}

function hint(status) {
  if (replaying()) return "A recording: nothing here commands a robot.";
  if (!status) return "";
  if (status.emergency_stop) return "The stop is latched. Release it, then start again.";
  return connection.mayCommand ? "A click on the map sets a goal." : "Reading only: unlock with the token to command.";
}

// ---- commands

const COMMANDS = {
  start: { label: "Start", done: "Started" },
  pause: { label: "Pause", done: "Paused" },
  resume: { label: "Resume", done: "Continues" },
  return_home: { label: "Return home", done: "On the way home" },
  explore: { label: "Continue exploring", done: "Explores" },
  goal: { label: "Goal…" },
  abort: { label: "Abort", sure: "The task ends where the robot is." },
  reset: { label: "New map", sure: "The robot forgets its map and begins another one." },
  stop_one: { label: "Stop this robot" },
};

function wanted(status) {
  if (!status || replaying()) return [];
  const main = { running: "pause", returning: "pause", holding: "pause", paused: "resume" }[status.state] ?? "start";
  const names = [main, "return_home", "goal"];
  if (status.target && status.task !== "navigation") names.push("explore");
  if (["running", "returning", "holding", "paused"].includes(status.state)) names.push("abort");
  names.push("reset");
  if (robots().length > 1) names.push("stop_one");
  return names;
}

function showButtons(status) {
  const names = wanted(status);
  const signature = names.join(" ");
  if ($("buttons").dataset.signature !== signature) {
    $("buttons").dataset.signature = signature;
    $("buttons").replaceChildren(...names.map((name, i) =>
      h("button", { class: i ? "" : "main", "data-verb": name, onclick: () => press(name) }, COMMANDS[name].label)));
  }
  const blocked = !connection.open || status?.emergency_stop;
  for (const button of $("buttons").children) button.disabled = blocked && !["stop_one", "reset", "abort"].includes(button.dataset.verb);
  $("commands").hidden = replaying();
}

async function press(name) {
  const { sure, done } = COMMANDS[name];
  if (name === "stop_one") return stop(selected);
  if (name === "goal") return askGoal();
  if (sure && !(await ask({ title: COMMANDS[name].label, text: sure, confirm: COMMANDS[name].label }))) return;
  await carryOut(connection, selected, name, {}, done ?? "");
}

async function stop(target) {
  const stopped = await carryOut(connection, target, "stop", { reason: "by the page" });
  if (stopped) notice("The stop is latched", "good");
}

async function release() {
  const found = await ask({
    title: `Release the stop of ${selected}`,
    text: "The robot stands until it is started again. Say who you are and why it is safe.",
    fields: [{ name: "who", label: "Who", autocomplete: "name" }, { name: "why", label: "Why it is safe" }],
    confirm: "Release",
    kind: "fault",
  });
  if (found) await carryOut(connection, selected, "release", found, "The stop is released");
}

async function askGoal() {
  const found = await ask({
    title: "Goal",
    text: "Where to, in metres of the map: x to the right, y up.",
    fields: [{ name: "x", label: "x (m)", value: pin ? pin[0].toFixed(2) : "" }, { name: "y", label: "y (m)", value: pin ? pin[1].toFixed(2) : "" }],
    confirm: "Go there",
    kind: "main",
    check: async ({ x, y }) => (x.trim() && y.trim() && Number.isFinite(Number(x)) && Number.isFinite(Number(y)) ? "" : "Both must be numbers of metres."),
  });
  if (found) await go(Number(found.x), Number(found.y));
}

async function go(x, y) {
  setPin(null);
  const where = `(${number(x)}, ${number(y, "m")})`;
  const { state } = value("status");
  if (!(await carryOut(connection, selected, "goal", { x, y }, `On the way to ${where}`))) return;
  // A robot that has no orders to move keeps the goal until it is told to.
  if (state === "paused") await carryOut(connection, selected, "resume", {});
  else if (!MOVING.has(state)) await carryOut(connection, selected, "start", {});
}

$("stop").addEventListener("click", () => stop(""));
$("release").addEventListener("click", release);
addEventListener("keydown", (event) => {
  if (event.key !== " " && event.key !== "Escape") return;
  if (event.repeat || replaying() || document.querySelector("dialog[open]") || event.target.closest("input[type=text], input[type=password]")) return;
  if (event.key === "Escape" && pin) return setPin(null);
  // The space bar stops, whichever button has the focus; buttons are pressed by Enter.
  event.preventDefault();
  stop("");
}, { capture: true });
addEventListener("keyup", (event) => {
  if (event.key === " " && event.target.closest("button")) event.preventDefault();
}, { capture: true });

// ---- the map

function drawMap(context, view) {
  const picture = belief();
  if (picture) picture.draw(context, [rgb("unknown"), rgb("free"), rgb("occupied")]);
  const robot = {
    status: value("status"), scene: value("scene"), pose: value("pose"), scan: value("scan"), path: value("path"), way: series("way"),
  };
  layers.draw(context, view, robot);
  if (pin) {
    drawPin(context, view, pin);
    placeMenu();
  }
  const { metres, pixels } = view.bar();
  setText($("scale-text"), metres < 1 ? `${metres * 100}\u202fcm` : `${metres}\u202fm`);
  $("scale-bar").style.width = `${pixels}px`;
  const { pose } = robot;
  const explored = robot.status ? `${number(robot.status.explored_area, "m²", 0)} explored` : "";
  $("map").setAttribute("aria-label", pose ? `Map: the robot is at ${number(pose[0])}, ${number(pose[1], "m")}; ${explored}` : "Map of what the robot knows");
}

function clickMap(x, y) {
  if (replaying() || !value("status")) return;
  setPin([x, y]);
  $("pin-go").focus({ preventScroll: true });
}

function setPin(place) {
  pin = place;
  $("pin-menu").hidden = !pin;
  if (pin) {
    setText($("pin-text"), `${number(pin[0], "", 2)}, ${number(pin[1], "m", 2)}`);
    const known = belief()?.at(...pin) === FREE;
    setText($("pin-note"), value("status")?.emergency_stop ? "The stop is latched." : known ? "" : "Not known to be free: it goes there as far as it can.");
    placeMenu();
  }
  map.redraw();
}

function placeMenu() {
  const menu = $("pin-menu"), [x, y] = map.at(...pin);
  const { clientWidth: width, clientHeight: height } = map.canvas;
  menu.style.left = `${Math.max(8, Math.min(x + 16, width - menu.offsetWidth - 8))}px`;
  menu.style.top = `${Math.max(8, Math.min(y + 16, height - menu.offsetHeight - 8))}px`;
}

$("pin-go").addEventListener("click", () => go(...pin));
$("pin-cancel").addEventListener("click", () => setPin(null));
$("zoom-in").addEventListener("click", () => map.zoom(1.3));
$("zoom-out").addEventListener("click", () => map.zoom(1 / 1.3));
$("fit").addEventListener("click", () => map.follow());
$("map").addEventListener("pointermove", (event) => {
  const [x, y] = map.place(event.offsetX, event.offsetY);
  setText($("place"), `${number(x, "", 2)}, ${number(y, "m", 2)}`);
});
$("map").addEventListener("pointerleave", () => setText($("place"), ""));
// For tests and the console: where a place of the map is on the screen.
$("map").toScreen = (x, y) => map.at(x, y);

// ---- a recording

function showReplay() {
  const replay = connection.values.get("replay");
  $("replay").hidden = !replay;
  if (!replay) return;
  setText($("replay-play"), replay.playing ? "❚❚" : "▶");
  $("replay-play").setAttribute("aria-label", replay.playing ? "Pause the recording" : "Play the recording");
  $("replay-at").max = replay.length;
  if (document.activeElement !== $("replay-at")) $("replay-at").value = replay.position;
  setText($("replay-text"), `${duration(replay.position)} of ${duration(replay.length)}`);
  setText($("replay-speed"), `${replay.speed}×`);
}

$("replay-play").addEventListener("click", () => carryOut(connection, "", connection.values.get("replay").playing ? "pause" : "play", {}));
$("replay-at").addEventListener("change", async (event) => {
  await carryOut(connection, "", "seek", { position: Number(event.target.value) });
  event.target.blur();
});
$("replay-speed").addEventListener("click", () => {
  const { speed } = connection.values.get("replay");
  carryOut(connection, "", "speed", { factor: SPEEDS[(SPEEDS.indexOf(speed) + 1) % SPEEDS.length] });
});

// ---- which robot

function select(name) {
  if (name === selected && connection.series.size) return;
  selected = name;
  setPin(null);
  map.follow();
  showDecisions(series("decisions") ?? []);
  showEvents($("events"), series("events") ?? []);
  showAll();
}

setInterval(() => connection.open && showDeck(value("status")), 1000);
