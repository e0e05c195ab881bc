// A map of numbers: columns from the left, rows from the top or from the bottom.
import { color } from "./dom.js";
import { shareOf, viridis } from "./colors.js";
import { Plot, clip } from "./plot.js";

const CROSS = 4;
const REACH = 7;

export class HeatMap extends Plot {
  #data = null;
  #image = null;

  /**
   * Shows other numbers.
   *
   * data.columns, data.rows: how many; data.values[column * rows + row]: NaN for none; data.range: of the colours,
   * or data.ranges, one for each row; data.below: {label, range} or {label, labels}, of the columns; data.left: the same,
   * of the rows; data.isUpward: whether the first row is at the bottom; data.bar: what the colours mean;
   * data.words(column, row): what is said of a cell; data.marked: a column that is marked; data.marks: cells with a
   * cross; data.height: in pixels.
   */
  show(data) {
    this.#data = data;
    this.#image = picture(data);
    this.drawAnew();
  }

  height() {
    return this.#data?.height ?? super.height();
  }

  margins() {
    const isNarrow = innerWidth < 600;
    return { left: this.#data?.left.labels ? (isNarrow ? 92 : 170) : 60, right: isNarrow ? 84 : 92, bottom: 44 };
  }

  paint(context, { x, y, width, height }) {
    const data = this.#data;
    if (data === null) return;
    context.fillStyle = color("--field");
    context.fillRect(x, y, width, height);
    context.imageSmoothingEnabled = false;
    context.drawImage(this.#image, x, y, width, height);
    this.border(context);
    if (data.marked !== undefined && data.marked !== null) {
      context.strokeStyle = color("--second");
      context.lineWidth = 2;
      context.strokeRect(x + (data.marked / data.columns) * width, y, width / data.columns, height);
    }
    for (const mark of data.marks ?? []) this.#cross(context, this.locate(mark));
    this.#axis(context, "below");
    this.#axis(context, "left");
    if (data.range) this.bar(context, data.range, data.bar);
    else this.bar(context, [0, 1], data.bar);
  }

  #cross(context, { x, y, width, height }) {
    const [left, top] = [x + width / 2, y + height / 2];
    for (const [line, stroke] of [[5, color("--paper")], [2.5, color("--bad")]]) {
      context.lineWidth = line;
      context.strokeStyle = stroke;
      context.beginPath();
      context.moveTo(left - CROSS, top - CROSS);
      context.lineTo(left + CROSS, top + CROSS);
      context.moveTo(left - CROSS, top + CROSS);
      context.lineTo(left + CROSS, top - CROSS);
      context.stroke();
    }
  }

  #axis(context, side) {
    const { x, y, width, height } = this.frame;
    const data = this.#data;
    const axis = data[side];
    const [start, length] = side === "below" ? [x, width] : [y, height];
    const isReversed = side === "left" && data.isUpward;
    if (axis.labels) {
      const count = axis.labels.length;
      const every = Math.ceil(count / Math.max(1, length / (side === "below" ? 70 : 16)));
      context.fillStyle = color("--soft");
      context.textBaseline = side === "below" ? "top" : "middle";
      context.textAlign = side === "below" ? "center" : "right";
      for (let index = 0; index < count; index += every) {
        const at = start + ((isReversed ? count - 1 - index : index) + 0.5) / count * length;
        const words = clip(context, axis.labels[index], side === "below" ? 66 : this.margins().left - 26);
        if (side === "below") context.fillText(words, at, y + height + 7);
        else context.fillText(words, x - 8, at);
      }
      if (side === "below") context.fillText(clip(context, axis.label, width), x + width / 2, y + height + 24);
      return;
    }
    const [low, high] = axis.range;
    const place = (value) => {
      const share = high > low ? (value - low) / (high - low) : 0.5;
      return start + (isReversed ? 1 - share : share) * length;
    };
    if (side === "below") this.axisBelow(context, axis.range, axis.label, place, axis);
    else this.axisLeft(context, axis.range, axis.label, place, axis);
  }

  pick(left, top) {
    const data = this.#data;
    const { x, y, width, height } = this.frame;
    if (data === null || left < x || top < y || left >= x + width || top >= y + height) return null;
    for (const mark of data.marks ?? []) {
      const at = this.locate(mark);
      if (Math.hypot(at.x + at.width / 2 - left, at.y + at.height / 2 - top) < REACH) return { column: mark.column, row: mark.row };
    }
    const column = Math.floor(((left - x) / width) * data.columns);
    const row = Math.floor(((top - y) / height) * data.rows);
    return { column, row: data.isUpward ? data.rows - 1 - row : row };
  }

  has({ column, row }) {
    return column < this.#data.columns && row < this.#data.rows;
  }

  describe({ column, row }) {
    return this.#data.words(column, row);
  }

  locate({ column, row }) {
    const { columns, rows, isUpward } = this.#data;
    const { x, y, width, height } = this.frame;
    return {
      x: x + (column / columns) * width, y: y + ((isUpward ? rows - 1 - row : row) / rows) * height,
      width: width / columns, height: height / rows,
    };
  }

  move(from, right, up) {
    const { columns, rows, isUpward } = this.#data;
    if (from === null) return { column: columns - 1, row: isUpward ? rows - 1 : 0 };
    const bound = (value, count) => Math.min(Math.max(value, 0), count - 1);
    return { column: bound(from.column + right, columns), row: bound(from.row + (isUpward ? up : -up), rows) };
  }
}

/** The cells as an image, a pixel each; cells without a number are empty. */
function picture({ columns, rows, values, range, ranges, isUpward }) {
  const image = new ImageData(Math.max(columns, 1), Math.max(rows, 1));
  for (let column = 0; column < columns; column += 1) {
    for (let row = 0; row < rows; row += 1) {
      const value = values[column * rows + row];
      if (!Number.isFinite(value)) continue;
      const at = 4 * ((isUpward ? rows - 1 - row : row) * columns + column);
      image.data.set([...viridis(shareOf(value, range ?? ranges[row])), 255], at);
    }
  }
  const canvas = document.createElement("canvas");
  canvas.width = image.width;
  canvas.height = image.height;
  canvas.getContext("2d").putImageData(image, 0, 0);
  return canvas;
}

