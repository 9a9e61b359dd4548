// A map on a canvas: metres, x right and y up; drag, wheel, pinch and keys move it, a click gives a place.

const STEPS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500];
const CLICK_PIXELS = 6;

export class MapView {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {(context: CanvasRenderingContext2D, view: MapView) => void} draw with units of metres; view.pixel is the
   *   size of a pixel in metres
   * @param {(x: number, y: number) => void} onClick a place, metres
   * @param {() => {left: number, right: number, low: number}} insets pixels at the sides and below that lie under
   *   something else: what is shown as a whole is shown between them
   */
  constructor(canvas, draw, onClick = () => {}, insets = () => ({ left: 0, right: 0, low: 0 })) {
    this.canvas = canvas;
    this.draw = draw;
    this.onClick = onClick;
    this.insets = insets;
    this.centre = [0, 0];
    this.scale = 20; // CSS pixels a metre
    this.follows = true; // keeps the box of fit() in sight until somebody moves the map
    this._pointers = new Map();
    this._due = false;
    canvas.addEventListener("pointerdown", (event) => this._down(event));
    canvas.addEventListener("pointermove", (event) => this._move(event));
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, (event) => this._up(event));
    canvas.addEventListener("wheel", (event) => this._wheel(event), { passive: false });
    canvas.addEventListener("keydown", (event) => this._key(event));
    new ResizeObserver(() => {
      this._refit();
      this.redraw();
    }).observe(canvas);
  }

  get pixel() {
    return 1 / this.scale;
  }

  redraw() {
    if (this._due) return;
    this._due = true;
    requestAnimationFrame(() => {
      this._due = false;
      this._paint();
    });
  }

  /** Keep a box [left, low, right, high] in sight, as long as nobody has moved the map. */
  fit(box) {
    this._box = box;
    this._refit();
  }

  /** Follow the box again. */
  follow() {
    this.follows = true;
    this._refit();
    this.redraw();
  }

  zoom(factor, x = this.canvas.clientWidth / 2, y = this.canvas.clientHeight / 2) {
    const before = this.place(x, y);
    this.scale = Math.min(Math.max(this.scale * factor, 0.5), 400);
    const after = this.place(x, y);
    this.centre = [this.centre[0] + before[0] - after[0], this.centre[1] + before[1] - after[1]];
    this.follows = false;
    this.redraw();
  }

  /** The place of a pixel of the canvas, metres. */
  place(x, y) {
    return [
      this.centre[0] + (x - this.canvas.clientWidth / 2) / this.scale,
      this.centre[1] - (y - this.canvas.clientHeight / 2) / this.scale,
    ];
  }

  /** The pixel of a place. */
  at(x, y) {
    return [
      (x - this.centre[0]) * this.scale + this.canvas.clientWidth / 2,
      this.canvas.clientHeight / 2 - (y - this.centre[1]) * this.scale,
    ];
  }

  /** The length of a scale bar, {metres, pixels}, about so wide. */
  bar(pixels = 110) {
    const metres = STEPS.findLast((step) => step * this.scale <= pixels) ?? STEPS[0];
    return { metres, pixels: metres * this.scale };
  }

  _refit() {
    if (!this.follows || !this._box) return;
    const [left, low, right, high] = this._box;
    const { clientWidth: width, clientHeight: height } = this.canvas;
    if (!width || !height) return;
    const inset = this.insets(), across = width - inset.left - inset.right, up = height - inset.low;
    this.scale = Math.min(across / Math.max(right - left, 1), up / Math.max(high - low, 1)) * 0.94;
    const aside = (inset.right - inset.left) / 2 / this.scale, below = inset.low / 2 / this.scale;
    this.centre = [(left + right) / 2 + aside, (low + high) / 2 - below];
  }

  _paint() {
    const ratio = devicePixelRatio || 1;
    const width = Math.round(this.canvas.clientWidth * ratio), height = Math.round(this.canvas.clientHeight * ratio);
    if (this.canvas.width !== width || this.canvas.height !== height) {
      this.canvas.width = width;
      this.canvas.height = height;
    }
    const context = this.canvas.getContext("2d");
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    const scale = this.scale * ratio;
    context.setTransform(scale, 0, 0, -scale, width / 2 - this.centre[0] * scale, height / 2 + this.centre[1] * scale);
    this.draw(context, this);
  }

  _down(event) {
    this.canvas.setPointerCapture(event.pointerId);
    this._pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    if (this._pointers.size === 1) this._pressed = [event.offsetX, event.offsetY];
    else this._pressed = null;
  }

  _move(event) {
    const before = this._pointers.get(event.pointerId);
    if (!before) return;
    const now = [event.offsetX, event.offsetY];
    if (this._pressed && Math.hypot(now[0] - this._pressed[0], now[1] - this._pressed[1]) <= CLICK_PIXELS) return;
    this._pressed = null;
    if (this._pointers.size === 2) {
      const other = [...this._pointers].find(([id]) => id !== event.pointerId)[1];
      const was = Math.hypot(before[0] - other[0], before[1] - other[1]);
      const is = Math.hypot(now[0] - other[0], now[1] - other[1]);
      if (was > 0) this.zoom(is / was, (now[0] + other[0]) / 2, (now[1] + other[1]) / 2);
    } else {
      this.centre = [
        this.centre[0] - (now[0] - before[0]) / this.scale,
        this.centre[1] + (now[1] - before[1]) / this.scale,
      ];
      this.follows = false;
    }
    this._pointers.set(event.pointerId, now);
    this.redraw();
  }

  _up(event) {
    this._pointers.delete(event.pointerId);
    if (this._pressed && event.type === "pointerup" && event.button === 0) this.onClick(...this.place(...this._pressed));
    this._pressed = null;
  }

  _wheel(event) {
    event.preventDefault();
    this.zoom(Math.exp(-event.deltaY * 0.0015), event.offsetX, event.offsetY);
  }

  _key(event) {
    const step = 60 / this.scale;
    const moves = { ArrowLeft: [-step, 0], ArrowRight: [step, 0], ArrowUp: [0, step], ArrowDown: [0, -step] };
    if (moves[event.key]) {
      this.centre = [this.centre[0] + moves[event.key][0], this.centre[1] + moves[event.key][1]];
      this.follows = false;
    } else if (event.key === "+" || event.key === "=") this.zoom(1.25);
    else if (event.key === "-") this.zoom(0.8);
    else if (event.key === "0") this.follow();
    else return;
    event.preventDefault();
    this.redraw();
  }
}
