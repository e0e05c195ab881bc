// A behaviour tree of modules: the root on the left, a row for each subtree with its condition and its behaviour.

const [LEAF_WIDTH, LEAF_HEIGHT, TREE_ROW, LEAF_LETTERS] = [136, 34, 52, 24];

class Tree extends Machine {
  size() {
    return [0, 0, 112 + STATE_RADIUS + 24 + 2 * LEAF_WIDTH, Math.max(this.machine.states.length, 1) * TREE_ROW + 8];
  }

  position(index) {
    return [112, index * TREE_ROW + TREE_ROW / 2 + 4];
  }

  // Draws the lines between root, subtrees and leaves, which are not transitions.
  arrows() {
    this.paths = [];
    const { states } = this.machine;
    const middle = (this.positions[0][1] + this.positions[states.length - 1][1]) / 2;
    const line = (...points) => this.svg.append(element("path", { d: `M${points.map((point) => point.join(" ")).join("L")}`, class: "arrow" }));
    this.positions.forEach(([x, y], index) => {
      line([66, middle], [x - STATE_RADIUS, y]);
      line([x + STATE_RADIUS, y], [x + 150, y]);
      const { condition, words } = states[index];
      this.leaf(x + STATE_RADIUS + 12, y, condition, `if ${condition}: the next subtree`, "condition");
      this.leaf(x + STATE_RADIUS + 20 + LEAF_WIDTH, y, words, `else ${words}`, "behaviour");
    });
    this.leaf(4, middle, "sequence*", "sequence with memory: continues with the subtree of the previous step, and restarts after the last subtree", "root", 62);
  }

  leaf(left, y, words, title, kind, width = LEAF_WIDTH) {
    const group = element("g", { class: `leaf ${kind}` });
    const rounded = kind === "condition" ? LEAF_HEIGHT / 2 : 3;
    const [name, rest] = words.split(" (");
    const lines = rest ? [name, `(${rest}`] : [name];
    group.append(element("rect", { x: left, y: y - LEAF_HEIGHT / 2, width, height: LEAF_HEIGHT, rx: rounded }));
    lines.forEach((text, index) => {
      const shown = text.length > LEAF_LETTERS ? `${text.slice(0, LEAF_LETTERS - 1)}…` : text;
      const at = { x: left + width / 2, y: y + (index - (lines.length - 1) / 2) * 13, class: index ? "value" : "" };
      group.append(element("text", at, shown));
    });
    group.append(element("title", {}, title));
    this.svg.append(group);
  }

  name() {
    return element("g");
  }

  lines() {
    super.lines();
    this.list.append(element("li", {}, "sequence*: sequence with memory, which continues with the subtree of the previous step"));
  }

  // Describes a subtree as text.
  words(row, index) {
    const { condition, words } = this.machine.states[index];
    const inner = element("ul");
    inner.append(element("li", {}, `else ${words}`));
    row.append(element("b", {}, `${index} next subtree if ${condition}`), inner);
  }
}
