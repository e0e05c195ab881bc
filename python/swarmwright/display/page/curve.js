// A number over the steps of one or several episodes; a thick line up to the current step, then a thin line.

class Curve {
  // several: the numbers of each episode, null for missing numbers. colors: names of colours, repeated if there are fewer.
  constructor(canvas, several, colors) {
    Object.assign(this, { canvas, several, colors: several.map((_, index) => colors[index % colors.length]) });
    this.longest = several.reduce((most, values) => (values.length > most.length ? values : most), []);
    let [low, high] = [Infinity, -Infinity];
    for (const values of several)
      for (const value of values)
        if (value !== null) [low, high] = [Math.min(low, value), Math.max(high, value)];
    this.hasNumbers = low <= high;
    if (!this.hasNumbers) [low, high] = [0, 1];
    [this.lowest, this.highest] = [low, high];
    const margin = high > low ? 0.06 * (high - low) : Math.max(Math.abs(high) * 0.1, 0.5);
    [this.low, this.high] = [low - margin, high + margin];
  }

  // only: draw a small chart with the smallest and the largest number.
  draw(time, only = false) {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const color = theme();
    const c = fit(this.canvas, width, height);
    this.context = c;
    c.font = FONT;
    const numbers = !this.hasNumbers ? [] : only ? [...new Set([this.lowest, this.highest])] : this.numbers(4);
    const apart = Math.abs(numbers[1] - numbers[0]);
    this.texts = numbers.map((value) => [value, wordsApart(value, apart)]);
    this.left = Math.max(26, ...this.texts.map(([, text]) => c.measureText(text).width + 10));
    const numbered = this.several.length > 1 && !only;
    // The last number is centred below the last step.
    const right = Math.max(numbered ? 26 : 10, c.measureText(String(this.longest.length - 1)).width / 2 + 3);
    this.box = { width: width - this.left - right, height: height - (only ? 18 : 44), top: only ? 10 : 8 };
    this.axes(color, only);
    if (!this.hasNumbers) {
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
    if (numbered) this.ends(color);
  }

  // Draws the numbers of the episodes beside the ends of their curves, without overlaps.
  ends(color) {
    const { context: c, box } = this;
    const lastPoints = this.several
      .map((values, index) => ({ index, at: values.findLastIndex((value) => value !== null) }))
      .filter(({ at }) => at >= 0)
      .map(({ index, at }) => ({ index, at, y: this.y(this.several[index][at]) }))
      .sort((a, b) => a.y - b.y || a.index - b.index);
    const row = Math.min(12, box.height / Math.max(lastPoints.length - 1, 1));
    const positions = lastPoints.map(({ y }) => y);
    for (let i = 1; i < positions.length; i++) positions[i] = Math.max(positions[i], positions[i - 1] + row);
    let lowest = box.top + box.height + 4;
    for (let i = positions.length - 1; i >= 0; i--, lowest -= row) positions[i] = Math.min(positions[i], lowest);
    const edge = this.left + box.width;
    c.textAlign = "left";
    c.textBaseline = "middle";
    lastPoints.forEach(({ index, at, y }, i) => {
      c.strokeStyle = color(this.colors[index]);
      c.lineWidth = 1;
      c.globalAlpha = 0.6;
      c.beginPath();
      c.moveTo(this.x(at), y);
      c.lineTo(edge, y);
      c.lineTo(edge + 9, positions[i]);
      c.stroke();
      c.globalAlpha = 1;
      c.fillStyle = color("ink");
      c.fillText(String(index + 1), edge + 11, positions[i]);
    });
  }

  numbers(most) {
    const step = spacing(this.high - this.low, most);
    const multiples = [];
    for (let i = Math.ceil(this.low / step); i * step <= this.high && multiples.length < 12; i++) multiples.push(i * step);
    return multiples;
  }

  axes(color, only) {
    const { context: c, box } = this;
    c.strokeStyle = color("grid");
    c.fillStyle = color("soft");
    c.lineWidth = 1;
    c.textAlign = "right";
    c.textBaseline = "middle";
    for (const [value, text] of this.texts) {
      const y = this.y(value);
      c.beginPath();
      c.moveTo(this.left, y);
      c.lineTo(this.left + box.width, y);
      c.stroke();
      c.fillText(text, this.left - 6, y);
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

  // Draws steps: a number holds until the next step.
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

  // Returns the step at a pixel.
  step(pixel) {
    const share = (pixel - this.left) / this.box.width;
    return Math.round(Math.min(Math.max(share, 0), 1) * (this.longest.length - 1));
  }
}
