// Points over two axes, coloured by a third number if there is one.
import { bounded, color, figure } from "./dom.js";
import { css, shareOf, viridis } from "./colors.js";
import { Plot } from "./plot.js";

const REACH = 12;
const MARGIN = 0.04;

export class Scatter extends Plot {
  #data = null;

  /**
   * Shows other points: data.x and data.y: {label, values}; data.shade: the same or null; data.ranges: {x, y, shade} that are
   * shown; data.steps: "pre", "post" or null, a line of steps that bounds the dominated region; data.words(index).
   */
  show(data) {
    this.#data = data;
    this.drawAnew();
  }

  margins() {
    return { left: 72, right: this.#data?.shade ? 92 : 12, bottom: 44 };
  }

  #place() {
    const { x, y, width, height } = this.frame;
    const { ranges } = this.#data;
    const wide = ([low, high]) => {
      const margin = MARGIN * (high - low || Math.abs(high) || 1);
      return [low - margin, high + margin].map(bounded);
    };
    const [across, up] = [wide(ranges.x), wide(ranges.y)];
    return {
      across, up,
      x: (value) => x + shareOf(value, across) * width,
      y: (value) => y + (1 - shareOf(value, up)) * height,
    };
  }

  paint(context, { x, y, width, height }) {
    const data = this.#data;
    if (data === null) return;
    const place = this.#place();
    this.border(context);
    this.axisBelow(context, place.across, data.x.label, place.x);
    this.axisLeft(context, place.up, data.y.label, place.y);
    const count = data.x.values.length;
    if (data.shade) this.bar(context, data.ranges.shade, data.shade.label);
    context.save();
    context.beginPath();
    context.rect(x, y, width, height);
    context.clip();
    if (data.steps) this.#steps(context, place);
    const radius = count > 3000 ? 2 : count > 300 ? 3 : 4.5;
    for (let index = count - 1; index >= 0; index -= 1) {
      const value = data.shade?.values[index];
      context.fillStyle = data.shade ? css(viridis(shareOf(value, data.ranges.shade))) : color("--accent");
      context.beginPath();
      context.arc(place.x(data.x.values[index]), place.y(data.y.values[index]), radius, 0, 7);
      context.fill();
      if (radius > 2) {
        context.strokeStyle = color("--paper");
        context.lineWidth = 0.75;
        context.stroke();
      }
    }
    context.restore();
  }

  #steps(context, place) {
    const { x, y } = this.#data;
    const order = Array.from(x.values.keys()).sort((left, right) => x.values[left] - x.values[right] || y.values[left] - y.values[right]);
    context.strokeStyle = color("--accent");
    context.globalAlpha = 0.5;
    context.lineWidth = 1;
    context.beginPath();
    order.forEach((index, at) => {
      const [left, top] = [place.x(x.values[index]), place.y(y.values[index])];
      if (at > 0) {
        const before = order[at - 1];
        if (this.#data.steps === "pre") context.lineTo(place.x(x.values[before]), top);
        else context.lineTo(left, place.y(y.values[before]));
      }
      context.lineTo(left, top);
    });
    context.stroke();
    context.globalAlpha = 1;
  }

  pick(left, top, pointer) {
    if (this.#data === null || this.#data.x.values.length === 0) return null;
    const place = this.#place();
    let [nearest, least] = [null, (pointer === "touch" ? 2 * REACH : REACH) ** 2];
    this.#data.x.values.forEach((value, index) => {
      const apart = (place.x(value) - left) ** 2 + (place.y(this.#data.y.values[index]) - top) ** 2;
      if (apart < least) [nearest, least] = [index, apart];
    });
    return nearest;
  }

  has(index) {
    return index < this.#data.x.values.length;
  }

  describe(index) {
    return this.#data.words(index);
  }

  locate(index) {
    const place = this.#place();
    return { x: place.x(this.#data.x.values[index]) - 5, y: place.y(this.#data.y.values[index]) - 5, width: 10, height: 10 };
  }

  /** The next point to the right or to the left; up and down do the same along the other axis. */
  move(from, right, up) {
    const axis = right ? this.#data.x.values : this.#data.y.values;
    const order = Array.from(axis.keys()).sort((first, second) => axis[first] - axis[second] || first - second);
    if (order.length === 0) return null;
    if (from === null) return order[order.length - 1];
    return order[Math.min(Math.max(order.indexOf(from) + right + up, 0), order.length - 1)];
  }
}

/** What a point has of each column. */
export function words(columns, index) {
  return Object.entries(columns).map(([name, values]) => `${name} ${figure(values[index])}`).join(", ");
}
