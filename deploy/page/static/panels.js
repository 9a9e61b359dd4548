// The lists beside the map: what a robot tells, in words and numbers with units.

import { count, duration, facts, h, moment, number } from "./core/dom.js";

const GATES = { clear: "good", held: "good", overridden: "caution", command_stale: "caution" };
const EVENTS_SHOWN = 40;
const PAST_SECONDS = 60;

const place = (at) => (at ? `${number(at[0], "", 1)}, ${number(at[1], "m", 1)}` : "");
const sentence = (text) => String(text ?? "").replaceAll("_", " ");

export function showTask(list, status) {
  if (!status) return facts(list, []);
  const unseen = status.unseen;
  facts(list, [
    ["Task", sentence(status.task)],
    ["Explored", number(status.explored_area, "m²", 0)],
    ["Driven", number(status.distance, "m", 1)],
    ["Under way", duration(status.duration)],
    ["Target", place(status.target)],
    ["Frontiers", count(status.frontiers, "cell")],
    ["Graph", `${count(status.viewpoints, "viewpoint")}, ${count(status.beacons, "beacon")}`],
    ["Left alone", status.bans ? count(status.bans, "place") : ""],
    ["Not seen", unseen ? number(unseen.length, "m", 1) : ""],
  ]);
}

export function showPlanner(list, status) {
  if (!status) return facts(list, []);
  const decides = status.relieved ? [`${status.planner}, for now`, "caution"] : [status.planner, ""];
  facts(list, [
    ["In charge", ...decides],
    ["Guard", status.guard ? `leaves it to ${status.guard}` : "", ""],
    ["Because", status.relieved],
    ["Policy", status.policy ? `${status.policy.run}, version ${status.policy.version}${status.policy.live ? ", live" : ""}` : ""],
    ["Last decision", moment(status.decision_seconds)],
    ["95 % within", moment(status.decision_p95)],
  ]);
}

export function showWatchdog(list, status, watchdog, pose) {
  if (!status) return facts(list, []);
  facts(list, [
    ["Mode", sentence(status.gate), GATES[status.gate] ?? "fault"],
    ["Because", status.gate_reason],
    ["Speed", pose?.length > 3 ? `${number(pose[3], "m/s", 2)}, ${number(pose[4], "rad/s", 2)}` : ""],
    ["Sent", watchdog ? `${number(watchdog.linear, "m/s", 2)}, ${number(watchdog.angular, "rad/s", 2)}` : ""],
    ["Sensor", watchdog?.sensor_age !== null && watchdog ? `${moment(watchdog.sensor_age)} old` : ""],
    ["Pose", watchdog?.pose_age !== null && watchdog ? `${moment(watchdog.pose_age)} old` : ""],
  ]);
}

export function showInputs(list, status) {
  if (!status) return facts(list, []);
  const dropped = Object.entries(status.dropped ?? {}).map(([why, count]) => `${count} ${sentence(why)}`);
  facts(list, [
    ...Object.entries(status.ages ?? {}).map(([name, age]) => [sentence(name), `${moment(age)} ago`]),
    ["Scans in the map", number(status.scans, "", 0)],
    ["Left out", dropped.join(", ")],
  ]);
}

export function showFaults(panel, status) {
  const faults = Object.entries(status?.faults ?? {});
  const past = status?.error && status.error.age < PAST_SECONDS ? status.error.text : "";
  const signature = JSON.stringify([faults, past]);
  if (panel.dataset.signature === signature) return;
  panel.dataset.signature = signature;
  panel.hidden = !faults.length && !past;
  // A warning of the log is no fault that lasts, and an alarm that tells its age anew each second is heard each second.
  panel.classList.toggle("past", !faults.length);
  panel.replaceChildren(
    ...faults.map(([kind, text]) => h("p", {}, h("strong", {}, `${sentence(kind)}: `), text)),
    ...(past ? [h("p", { class: "past" }, h("strong", {}, "last warning: "), past)] : []));
}

export function showEvents(list, events) {
  const shown = events.slice(-EVENTS_SHOWN).reverse();
  list.replaceChildren(...shown.map(([at, state, reason, planner, guard, relieved]) => {
    const who = relieved ? `${planner} relieves: ${relieved}` : guard ? `${planner}, guard: ${guard}` : planner;
    const time = new Date(at * 1000);
    return h("li", {},
      h("time", { datetime: time.toISOString() }, time.toLocaleTimeString("en-GB")),
      h("div", {}, h("b", {}, sentence(state)), reason ? `: ${reason}` : "", h("div", { class: "quiet-text" }, who)));
  }));
}
