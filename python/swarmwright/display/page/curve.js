// A number over the steps, of one episode or several; what has been played is drawn strongly, the rest thinly.

class Curve {
  // several: for each episode its numbers, null where there is none. colors: names of theirs.
  constructor(canvas, several, colors) {
    Object.assign(this, { canvas, several, colors });
    this.longest = several.reduce((most, values) => (values.length > most.length ? values : most), []);
    let [low, high] = [Infinity, -Infinity];
    for (const values of several)
      for (const value of values)
        if (value !== null) [low, high] = [Math.min(low, value), Math.max(high, value)];
    this.known = low <= high;
    if (!this.known) [low, high] = [0, 1];
    const margin = high > low ? 0.06 * (high - low) : Math.max(Math.abs(high) * 0.1, 0.5);
    [this.low, this.high] = [low - margin, high + margin];
  }

  // `only`: without numbers of steps, for a small chart.
  draw(time, only = false) {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const color = theme();
    const c = fit(this.canvas, width, height);
    this.context = c;
    c.font = FONT;
    const numbers = this.known ? this.numbers(only ? 2 : 4) : [];
    this.left = Math.max(26, ...numbers.map((value) => c.measureText(words(value)).width + 10));
    // The last number stands in the middle below the last step.
    const right = Math.max(10, c.measureText(String(this.longest.length - 1)).width / 2 + 3);
    this.box = { width: width - this.left - right, height: height - (only ? 18 : 44), top: only ? 10 : 8 };
    this.axes(color, numbers, only);
    if (!this.known) {
      c.textAlign = "center";
      c.fillText("no finite number", this.left + this.box.width / 2, height / 2);
      return;
    }
    this.several.forEach((values, index) => {
      const last = values.length - 1;
      const alone = this.several.length === 1;
      this.curve(values, last, color(alone ? "soft" : this.colors[index]), 1, 0.55);
      this.curve(values, Math.min(time, last), color(this.colors[index]), 2.5, 1);
      const now = Math.min(time, last);
      const value = values[Math.floor(now)];
      if (value === null) return;
      c.beginPath();
      c.arc(this.x(now), this.y(value), only ? 3.5 : 5, 0, 2 * Math.PI);
      c.fillStyle = color(this.colors[index]);
      c.strokeStyle = color("paper");
      c.lineWidth = 2;
      c.fill();
      c.stroke();
    });
  }

  numbers(most) {
    const step = spacing(this.high - this.low, most);
    const found = [];
    for (let i = Math.ceil(this.low / step); i * step <= this.high && found.length < 12; i++) found.push(i * step);
    return found;
  }

  axes(color, numbers, only) {
    const { context: c, box } = this;
    c.strokeStyle = color("grid");
    c.fillStyle = color("soft");
    c.lineWidth = 1;
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const value of numbers) {
      const y = this.y(value);
      c.beginPath();
      c.moveTo(this.left, y);
      c.lineTo(this.left + box.width, y);
      c.stroke();
      c.fillText(words(value), this.left - 6, y);
    }
    if (only) return;
    c.textAlign = "center";
    c.textBaseline = "top";
    const last = this.longest.length - 1;
    const step = Math.max(1, spacing(Math.max(last, 1), 5));
    for (let i = 0; i <= last; i += step) c.fillText(String(i), this.x(i), box.top + box.height + 5);
    c.textBaseline = "bottom";
    c.fillText("step", this.left + box.width / 2, box.top + box.height + 35);
  }

  // The number of a step holds until the next step.
  curve(values, until, color, width, alpha) {
    const { context: c } = this;
    c.strokeStyle = color;
    c.lineWidth = width;
    c.lineJoin = "round";
    c.globalAlpha = alpha;
    c.beginPath();
    let pen = false;
    for (let i = 0; i <= until; i++) {
      if (values[i] === null) {
        pen = false;
        continue;
      }
      if (pen) c.lineTo(this.x(i), this.y(values[i - 1]));
      c[pen ? "lineTo" : "moveTo"](this.x(i), this.y(values[i]));
      pen = true;
    }
    if (pen) c.lineTo(this.x(until), this.y(values[Math.floor(until)]));
    c.stroke();
    c.globalAlpha = 1;
  }

  x(time) {
    return this.left + (this.box.width * time) / Math.max(this.longest.length - 1, 1);
  }

  y(value) {
    return this.box.top + (this.box.height * (this.high - value)) / (this.high - this.low);
  }

  // The step at a pixel.
  step(pixel) {
    const share = (pixel - this.left) / this.box.width;
    return Math.round(Math.min(Math.max(share, 0), 1) * (this.longest.length - 1));
  }
}
