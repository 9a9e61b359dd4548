// Grids in tiles of 64 x 64 cells (docs/page.md): reading the frames, and keeping a picture of what they tell.

export const SIDE = 64;
export const UNKNOWN = 0, FREE = 1, OCCUPIED = 2;

/** Read a binary frame: {name, whole, anchor: [x, y], resolution, tiles: [{row, column, cells}]}. */
export function readTiles(buffer) {
  const view = new DataView(buffer);
  if (view.getUint8(0) !== 1) throw new Error(`unknown binary frame ${view.getUint8(0)}`);
  const length = view.getUint8(1);
  const name = new TextDecoder().decode(new Uint8Array(buffer, 2, length));
  let at = 2 + length;
  const whole = view.getUint8(at) === 1;
  const anchor = [view.getFloat64(at + 1, true), view.getFloat64(at + 9, true)];
  const resolution = view.getFloat64(at + 17, true);
  const count = view.getUint16(at + 25, true);
  at += 27;
  const tiles = [];
  for (let i = 0; i < count; i++) {
    const row = view.getInt16(at, true), column = view.getInt16(at + 2, true), size = view.getUint16(at + 4, true);
    const cells = new Uint8Array(SIDE * SIDE);
    let cell = 0;
    for (const run of new Uint8Array(buffer, at + 6, size)) {
      const end = cell + (run & 63) + 1;
      cells.fill(run >> 6, cell, end);
      cell = end;
    }
    tiles.push({ row, column, cells });
    at += 6 + size;
  }
  return { name, whole, anchor, resolution, tiles };
}

/** A grid as it is known so far, each tile a small canvas in the colours of the page. */
export class TilePicture {
  constructor() {
    this.clear();
  }

  clear() {
    this.tiles = new Map();
    this.resolution = 0;
    this.anchor = [0, 0];
    this._box = null;
  }

  take(frame) {
    if (frame.whole) this.clear();
    this.resolution = frame.resolution;
    this.anchor = frame.anchor;
    for (const { row, column, cells } of frame.tiles) {
      const key = `${row},${column}`, known = knownCells(cells);
      if (!known) {
        this.tiles.delete(key);
        continue;
      }
      const tile = this.tiles.get(key) ?? { row, column, canvas: null };
      tile.cells = cells;
      tile.known = known;
      tile.stale = true;
      this.tiles.set(key, tile);
    }
    this._box = null;
  }

  /** The colours changed: paint everything anew when it is drawn next. */
  repaint() {
    for (const tile of this.tiles.values()) tile.stale = true;
  }

  /** The box [left, low, right, high] of all that is known, metres; null while nothing is. */
  get box() {
    return (this._box ??= this._knownBox());
  }

  /** Draw into a context whose units are metres with y up; colours are [r, g, b] by state. */
  draw(context, colours) {
    const metres = SIDE * this.resolution;
    context.imageSmoothingEnabled = false;
    for (const tile of this.tiles.values()) {
      if (tile.stale) paint(tile, colours);
      context.save();
      context.translate(this.anchor[0] + tile.column * metres, this.anchor[1] + tile.row * metres);
      context.scale(this.resolution, this.resolution);
      context.drawImage(tile.canvas, 0, 0);
      context.restore();
    }
  }

  /** State of the cell at a place, metres. */
  at(x, y) {
    const column = Math.floor((x - this.anchor[0]) / this.resolution);
    const row = Math.floor((y - this.anchor[1]) / this.resolution);
    const tile = this.tiles.get(`${Math.floor(row / SIDE)},${Math.floor(column / SIDE)}`);
    if (!tile) return UNKNOWN;
    return tile.cells[((row % SIDE) + SIDE) % SIDE * SIDE + ((column % SIDE) + SIDE) % SIDE];
  }

  _knownBox() {
    let box = null;
    for (const { row, column, known } of this.tiles.values()) {
      const x = (cells) => this.anchor[0] + (column * SIDE + cells) * this.resolution;
      const y = (cells) => this.anchor[1] + (row * SIDE + cells) * this.resolution;
      const here = [x(known[0]), y(known[1]), x(known[2]), y(known[3])];
      box = box ? [...[0, 1].map((i) => Math.min(box[i], here[i])), ...[2, 3].map((i) => Math.max(box[i], here[i]))] : here;
    }
    return box;
  }
}

/** The box [left, low, right, high] of the cells of a tile that are known, null without any. */
function knownCells(cells) {
  let left = SIDE, low = SIDE, right = 0, high = 0;
  cells.forEach((cell, i) => {
    if (cell === UNKNOWN) return;
    const column = i % SIDE, row = (i - column) / SIDE;
    left = Math.min(left, column);
    right = Math.max(right, column + 1);
    low = Math.min(low, row);
    high = Math.max(high, row + 1);
  });
  return high ? [left, low, right, high] : null;
}

function paint(tile, colours) {
  tile.canvas ??= new OffscreenCanvas(SIDE, SIDE);
  const context = tile.canvas.getContext("2d");
  const picture = context.createImageData(SIDE, SIDE);
  const words = new Uint32Array(picture.data.buffer);
  const little = colours.map(([r, g, b], state) => (state === UNKNOWN ? 0 : (255 << 24) | (b << 16) | (g << 8) | r));
  for (let i = 0; i < words.length; i++) words[i] = little[tile.cells[i]];
  context.putImageData(picture, 0, 0);
  tile.stale = false;
}
