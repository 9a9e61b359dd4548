// Small helpers: elements, colours, numbers with units, notices and dialogs.

/** Make an element: h("button", {class: "quiet", onclick: go}, "Go"). */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (value === false || value === null || value === undefined) continue;
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else element.setAttribute(name, value === true ? "" : value);
  }
  element.append(...children.flat().filter((child) => child !== null && child !== undefined && child !== false));
  return element;
}

/** Change an element's text only when it differs, so that screen readers and selections are left alone. */
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** The colour of a meaning (common/palette.py) in the scheme of this moment, such as colour("frontier"). */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();
}

/** The same as [r, g, b]. */
export function rgb(name) {
  const number = parseInt(colour(name).slice(1), 16);
  return [number >> 16, (number >> 8) & 255, number & 255];
}

/** Call back whenever the scheme changes from light to dark or back. */
export function onScheme(handler) {
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", handler);
  document.documentElement.addEventListener("schemechange", handler);
}

const NONE = "–";

/** A number with its unit and a narrow space between: number(3.14159, "m", 1) is "3.1 m". */
export function number(value, unit = "", digits = 1) {
  if (value === null || value === undefined || !Number.isFinite(value)) return NONE;
  const text = value.toLocaleString("en", { minimumFractionDigits: digits, maximumFractionDigits: digits });
  return unit ? `${text}\u202f${unit}` : text;
}

/** A number of things: "1 beacon", "3 beacons". */
export function count(many, what) {
  return `${number(many, "", 0)} ${what}${many === 1 ? "" : "s"}`;
}

/** Seconds as people read them: "0.8 s", "42 s", "3 min 05 s", "2 h 07 min". */
export function duration(seconds) {
  if (!Number.isFinite(seconds)) return NONE;
  if (seconds < 10) return number(seconds, "s", 1);
  const whole = Math.round(seconds);
  if (whole < 60) return `${whole}\u202fs`;
  const two = (n) => String(n).padStart(2, "0");
  if (whole < 3600) return `${Math.floor(whole / 60)}\u202fmin ${two(whole % 60)}\u202fs`;
  return `${Math.floor(whole / 3600)}\u202fh ${two(Math.floor(whole / 60) % 60)}\u202fmin`;
}

/** A time within a decision: milliseconds below a second. */
export function moment(seconds) {
  if (!Number.isFinite(seconds)) return NONE;
  return seconds < 1 ? number(seconds * 1000, "ms", seconds < 0.01 ? 1 : 0) : number(seconds, "s", 2);
}

/** Show [name, text, tone] as a definition list; what did not change is left alone, what has no text is left out. */
export function facts(list, rows) {
  const shown = rows.filter(([, text]) => text !== null && text !== undefined && text !== "");
  const names = shown.map(([name]) => name).join("|");
  if (list.dataset.names !== names) {
    list.dataset.names = names;
    list.replaceChildren(...shown.flatMap(([name]) => [h("dt", {}, name), h("dd", {})]));
  }
  const places = list.querySelectorAll("dd");
  shown.forEach(([, text, tone], i) => {
    setText(places[i], text);
    places[i].className = tone ? `badge ${tone}` : "";
  });
}

/** Say something for a few seconds; screen readers hear it. Kind: "info", "good" or "fault". */
export function notice(text, kind = "info") {
  let place = document.getElementById("notices");
  if (!place) {
    place = h("div", { id: "notices", role: "status", "aria-live": "polite" });
    document.body.append(place);
  }
  const item = h("div", { class: `notice ${kind}` }, text);
  place.append(item);
  while (place.children.length > 4) place.firstChild.remove();
  setTimeout(() => item.remove(), kind === "fault" ? 12000 : 5000);
}

/**
 * Ask with a dialog; resolves to the form's fields, or null when it is cancelled.
 * @param {{title: string, text?: string, fields?: {name: string, label: string, type?: string, value?: string,
 *   autocomplete?: string}[], confirm: string, kind?: string, check?: (fields: object) => Promise<string>}} what
 */
export function ask({ title, text = "", fields = [], confirm, kind = "", check = null }) {
  return new Promise((resolve) => {
    const inputs = fields.map(({ name, label, type = "text", value = "", autocomplete = "off" }) =>
      h("label", {}, h("span", {}, label), h("input", { name, type, value, autocomplete, required: true, maxlength: 200 })));
    const problem = h("p", { class: "problem", role: "alert" });
    const go = h("button", { type: "submit", class: kind }, confirm);
    let result = null;
    const form = h("form", { method: "dialog" },
      h("h2", { id: "dialog-title" }, title), text ? h("p", {}, text) : null, ...inputs, problem,
      h("div", { class: "row end" }, h("button", { type: "button", class: "quiet", onclick: () => dialog.close() }, "Cancel"), go));
    const dialog = h("dialog", { "aria-labelledby": "dialog-title" }, form);
    form.addEventListener("submit", async (event) => {
      event.preventDefault();
      const found = Object.fromEntries(new FormData(form));
      if (check) {
        go.disabled = true;
        const why = await check(found);
        go.disabled = false;
        if (why) {
          problem.textContent = why;
          return;
        }
      }
      result = found;
      dialog.close();
    });
    dialog.addEventListener("close", () => {
      dialog.remove();
      resolve(result);
    });
    document.body.append(dialog);
    dialog.showModal();
  });
}
