// The episode as pictures that the simulation rendered; replaces the map.

class Pictures {
  constructor(canvas, episode, ready) {
    this.canvas = canvas;
    this.episode = episode;
    this.selected = -1;
    this.images = episode.pictures.map((address) => {
      const image = new Image();
      image.addEventListener("load", ready);
      image.src = address;
      return image;
    });
  }

  draw(time, view) {
    const { width, height } = this.episode;
    const room = this.canvas.parentElement.clientWidth;
    const highest = Math.max(240, view.highest);
    const scale = Math.min(room / width, highest / height);
    this.canvas.style.height = `${height * scale}px`;
    const context = fit(this.canvas, room, height * scale);
    const image = this.images[this.at(Math.floor(time))];
    const box = [(room - width * scale) / 2, 0, width * scale, height * scale];
    if (image.complete) context.drawImage(image, ...box);
    context.strokeStyle = theme()("line");
    context.strokeRect(...box);
  }

  // Returns the index of the latest picture at a step.
  at(step) {
    let latest = 0;
    this.episode.picture_steps.forEach((drawn, index) => drawn <= step && (latest = index));
    return latest;
  }
}
