// What every page has around it: the connection's state, the token, light and dark.

import { ask, h, notice, setText } from "./dom.js";

const SCHEME_KEY = "hd-page-scheme";
const SCHEMES = { auto: "Automatic colours", light: "Light colours", dark: "Dark colours" };
const SIGNS = { auto: "◐", light: "○", dark: "●" };

/** Put the page's tools (connection, token, colours) into an element of its header. */
export function attachShell(connection, place) {
  const state = h("span", { class: "connection", role: "status" });
  const lock = h("button", { class: "quiet", onclick: () => (connection.mayCommand ? lockAgain(connection) : askToken(connection)) });
  const scheme = h("button", { class: "quiet icon", onclick: () => nextScheme(scheme) });
  place.append(state, lock, scheme);
  showScheme(scheme, localStorage.getItem(SCHEME_KEY) ?? "auto");
  const show = () => {
    state.className = `connection ${connection.open ? "open" : "lost"}`;
    setText(state, connection.open ? "live" : "not connected");
    setText(lock, connection.mayCommand ? "Lock" : "Unlock");
    lock.title = connection.mayCommand ? "Give the right to command back" : "Enter the token that allows to command";
    document.documentElement.toggleAttribute("data-lost", !connection.open);
    document.documentElement.toggleAttribute("data-commands", connection.mayCommand);
  };
  connection.on("state", show);
  show();
}

/** Ask for the token until it is right or the dialog is cancelled; resolves to whether commands are allowed. */
export async function askToken(connection, why = "") {
  if (connection.mayCommand) return true;
  await ask({
    title: "Command",
    text: `${why ? `${why} ` : ""}Enter the token that was printed when the page started.`,
    fields: [{ name: "token", label: "Token", type: "password" }],
    confirm: "Unlock",
    check: async ({ token }) => {
      if (await connection.unlock(token)) return "";
      return connection.open ? connection.why || "this token is wrong" : "not connected to the page's process";
    },
  });
  return connection.mayCommand;
}

/** Command, asking for the token first where it lacks; says what became of it and resolves to whether it was done. */
export async function carryOut(connection, target, verb, args, done = "") {
  if (!connection.mayCommand && !(await askToken(connection, "Commands need the token."))) return false;
  try {
    await connection.command(target, verb, args);
    if (done) notice(done, "good");
    return true;
  } catch (error) {
    notice(error.message, "fault");
    return false;
  }
}

async function lockAgain(connection) {
  await connection.unlock("");
  notice("Commands are locked");
}

function nextScheme(button) {
  const names = Object.keys(SCHEMES);
  const next = names[(names.indexOf(localStorage.getItem(SCHEME_KEY) ?? "auto") + 1) % names.length];
  localStorage.setItem(SCHEME_KEY, next);
  showScheme(button, next);
}

function showScheme(button, name) {
  if (name === "auto") document.documentElement.removeAttribute("data-scheme");
  else document.documentElement.setAttribute("data-scheme", name);
  setText(button, SIGNS[name]);
  button.setAttribute("aria-label", `${SCHEMES[name]}; press for the next`);
  button.title = SCHEMES[name];
  document.documentElement.dispatchEvent(new Event("schemechange"));
}
