// Fitness so far over the steps; what has been played is drawn strongly, the rest thinly.

class FitnessCurve {
  constructor(canvas, fitness) {
    this.canvas = canvas;
    this.fitness = fitness;
    const finite = fitness.filter((value) => value !== null);
    this.known = finite.length > 0;
    let [low, high] = this.known ? [Math.min(...finite), Math.max(...finite)] : [0, 1];
    const margin = high > low ? 0.06 * (high - low) : Math.max(Math.abs(high) * 0.1, 0.5);
    [this.low, this.high] = [low - margin, high + margin];
  }

  draw(time) {
    const [width, height] = [this.canvas.clientWidth, this.canvas.clientHeight];
    const color = theme();
    const c = fit(this.canvas, width, height);
    this.context = c;
    c.font = "12px system-ui, 'DejaVu Sans', sans-serif";
    const numbers = this.known ? this.numbers() : [];
    this.left = Math.max(26, ...numbers.map((value) => c.measureText(words(value)).width + 10));
    // The last number stands in the middle below the last step.
    const right = Math.max(10, c.measureText(String(this.fitness.length - 1)).width / 2 + 3);
    this.box = { width: width - this.left - right, height: height - 44, top: 8 };
    this.axes(color, numbers);
    if (!this.known) {
      c.textAlign = "center";
      c.fillText("no finite number", this.left + this.box.width / 2, height / 2);
      return;
    }
    const last = this.fitness.length - 1;
    this.curve(last, color("soft"), 1, 0.55);
    this.curve(time, color("accent"), 2.5, 1);
    const value = this.fitness[Math.floor(time)];
    if (value === null) return;
    c.beginPath();
    c.arc(this.x(time), this.y(value), 5, 0, 2 * Math.PI);
    c.fillStyle = color("accent");
    c.strokeStyle = color("paper");
    c.lineWidth = 2;
    c.fill();
    c.stroke();
  }

  numbers() {
    const step = spacing(this.high - this.low, 4);
    const found = [];
    for (let i = Math.ceil(this.low / step); i * step <= this.high && found.length < 12; i++) found.push(i * step);
    return found;
  }

  axes(color, numbers) {
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
    c.textAlign = "center";
    c.textBaseline = "top";
    const last = this.fitness.length - 1;
    const step = Math.max(1, spacing(Math.max(last, 1), 5));
    for (let i = 0; i <= last; i += step) c.fillText(String(i), this.x(i), box.top + box.height + 5);
    c.textBaseline = "bottom";
    c.fillText("step", this.left + box.width / 2, box.top + box.height + 35);
  }

  // A step's fitness holds until the next step.
  curve(until, color, width, alpha) {
    const { context: c } = this;
    c.strokeStyle = color;
    c.lineWidth = width;
    c.lineJoin = "round";
    c.globalAlpha = alpha;
    c.beginPath();
    let pen = false;
    for (let i = 0; i <= until; i++) {
      if (this.fitness[i] === null) {
        pen = false;
        continue;
      }
      if (pen) c.lineTo(this.x(i), this.y(this.fitness[i - 1]));
      c[pen ? "lineTo" : "moveTo"](this.x(i), this.y(this.fitness[i]));
      pen = true;
    }
    if (pen) c.lineTo(this.x(until), this.y(this.fitness[Math.floor(until)]));
    c.stroke();
    c.globalAlpha = 1;
  }

  x(time) {
    return this.left + (this.box.width * time) / Math.max(this.fitness.length - 1, 1);
  }

  y(value) {
    return this.box.top + (this.box.height * (this.high - value)) / (this.high - this.low);
  }

  // The step at a pixel.
  step(pixel) {
    const share = (pixel - this.left) / this.box.width;
    return Math.round(Math.min(Math.max(share, 0), 1) * (this.fitness.length - 1));
  }
}
