// The page's end of the WebSocket (docs/page.md): it keeps the newest of every channel, and comes again by itself.

import { readTiles } from "./tiles.js";

const PROTOCOL = 1;
const SILENT_MS = 8000;
// The page's process answers in its own time, which a checkpoint may take a minute of; a silent one is noticed sooner.
const ANSWER_MS = 75000;
const TOKEN_KEY = "hd-page-token";

export class Connection {
  /**
   * @param {string[]} channels patterns of channels to watch, such as "robot/*"
   *
   * Handlers: on("state", ({open, mayCommand, why}) => ...), on("value:NAME", value => ...),
   * on("values", (name, value) => ...), on("series", (name, items, whole) => ...), on("tiles", frame => ...),
   * on("gone", name => ...), on("hello", hello => ...), on("news", () => ...) after each frame.
   */
  constructor(channels) {
    this.channels = channels;
    this.values = new Map();
    this.series = new Map();
    this.open = false;
    this.mayCommand = false;
    this.why = "";
    this.hello = null;
    this._handlers = new Map();
    this._answers = new Map();
    this._number = 0;
    this._delay = 500;
    this._takeTokenFromAddress();
    this._connect();
    setInterval(() => this._checkSilence(), 1000);
  }

  on(event, handler) {
    if (!this._handlers.has(event)) this._handlers.set(event, []);
    this._handlers.get(event).push(handler);
    return this;
  }

  /** Call back at most once for each frame of the screen, after news. */
  onNews(handler) {
    let due = false;
    return this.on("news", () => {
      if (due) return;
      due = true;
      requestAnimationFrame(() => {
        due = false;
        handler();
      });
    });
  }

  /** Watch other channels from now on; what is known of those that remain stays. */
  watch(channels) {
    this.channels = channels;
    if (this.open) this._send({ type: "watch", channels: ["page/time", ...channels] });
  }

  get token() {
    return sessionStorage.getItem(TOKEN_KEY) ?? "";
  }

  /** Show a token; resolves to whether it is right. */
  unlock(token) {
    if (token) sessionStorage.setItem(TOKEN_KEY, token);
    else sessionStorage.removeItem(TOKEN_KEY);
    if (!this.open) return Promise.resolve(false);
    return new Promise((resolve) => {
      this._welcomed = resolve;
      this._send({ type: "hello", protocol: PROTOCOL, token });
    });
  }

  /** Command; resolves to the state after it, and throws an Error that says why not. */
  command(target, verb, args = {}) {
    if (!this.open) return Promise.reject(new Error("not connected to the page's process"));
    const id = ++this._number;
    this._send({ type: "command", id, target, verb, arguments: args });
    return new Promise((resolve, reject) => {
      const timer = setTimeout(() => {
        this._answers.delete(id);
        reject(new Error(`no answer within ${ANSWER_MS / 1000} s`));
      }, ANSWER_MS);
      this._answers.set(id, { resolve, reject, timer });
    });
  }

  /** Milliseconds since the page's process said anything. */
  get silence() {
    return performance.now() - (this._heard ?? 0);
  }

  _connect() {
    const url = new URL("ws", location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    url.hash = "";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    socket.onmessage = (event) => {
      this._heard = performance.now();
      if (typeof event.data === "string") this._take(JSON.parse(event.data));
      else this._emit("tiles", readTiles(event.data));
      this._emit("news");
    };
    socket.onclose = (event) => this._lost(event.reason);
    this._socket = socket;
  }

  _take(message) {
    if (message.type === "hello") {
      if (message.protocol !== PROTOCOL) {
        location.reload();
        return;
      }
      this.hello = message;
      this.open = true;
      this._delay = 500;
      // A new connection brings everything anew.
      this.values.clear();
      this.series.clear();
      this._emit("hello", message);
      this._send({ type: "hello", protocol: PROTOCOL, token: this.token });
      this.watch(this.channels);
      this._emitState();
    } else if (message.type === "welcome") {
      this.mayCommand = message.may_command;
      this.why = message.why;
      if (!message.may_command) sessionStorage.removeItem(TOKEN_KEY);
      this._welcomed?.(message.may_command);
      this._welcomed = null;
      this._emitState();
    } else if (message.type === "update") {
      this._update(message);
    } else if (message.type === "answer") {
      const waiting = this._answers.get(message.id);
      if (!waiting) return;
      this._answers.delete(message.id);
      clearTimeout(waiting.timer);
      if (message.ok) waiting.resolve(message.state);
      else waiting.reject(new Error(message.error));
    } else if (message.type === "error") {
      this.why = message.error;
    }
  }

  _update({ values = {}, series = {}, gone = [] }) {
    for (const name of gone) {
      this.values.delete(name);
      this.series.delete(name);
      this._emit("gone", name);
    }
    for (const [name, value] of Object.entries(values)) {
      this.values.set(name, value);
      this._emit(`value:${name}`, value);
      this._emit("values", name, value);
    }
    for (const [name, { start, items }] of Object.entries(series)) {
      const before = this.series.get(name);
      const whole = before?.next !== start;
      const kept = whole ? { items: [] } : before;
      kept.items.push(...items);
      kept.next = start + items.length;
      this.series.set(name, kept);
      this._emit("series", name, kept.items, whole);
    }
  }

  _lost(reason) {
    if (this._socket) this._socket.onclose = this._socket.onmessage = null;
    this.open = this.mayCommand = false;
    if (reason) this.why = reason;
    for (const { reject, timer } of this._answers.values()) {
      clearTimeout(timer);
      reject(new Error("the connection broke before the answer: look at the state"));
    }
    this._answers.clear();
    this._welcomed?.(false);
    this._welcomed = null;
    this._emitState();
    setTimeout(() => this._connect(), this._delay);
    this._delay = Math.min(this._delay * 2, 5000);
  }

  _checkSilence() {
    // A connection that says nothing is as good as none; what is on the page would be a lie. A browser that was busy
    // itself has the news still before it.
    const now = performance.now(), late = now - (this._checked ?? now) > 2500;
    this._checked = now;
    if (!late && this.open && this.silence > SILENT_MS) {
      this._socket.close();
      this._lost("the page's process is silent");
    }
  }

  _takeTokenFromAddress() {
    const found = new URLSearchParams(location.hash.slice(1)).get("token");
    if (found === null) return;
    sessionStorage.setItem(TOKEN_KEY, found);
    history.replaceState(null, "", location.pathname + location.search);
  }

  _send(message) {
    this._socket.send(JSON.stringify(message));
  }

  _emitState() {
    this._emit("state", { open: this.open, mayCommand: this.mayCommand, why: this.why });
  }

  _emit(event, ...values) {
    for (const handler of this._handlers.get(event) ?? []) handler(...values);
  }
}
