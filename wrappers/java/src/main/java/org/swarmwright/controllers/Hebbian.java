package org.swarmwright.controllers;

/**
 * A recurrent network in which every node hears every node, and whose weights learn in each step
 * (FREVO's HebbNet).
 *
 * <p>Nodes: sensors, then hidden, then actuators. Weights: the learning rate, then for every node
 * that is not a sensor, in that order: the bias, then one weight from every node, itself included.
 * The outputs of all nodes and what the weights have become stay from step to step.
 */
final strictfp class Hebbian extends Architecture {
  private static final int MAX_ITERATIONS = 1000;

  private final int hidden;
  private final int iterations;

  private Hebbian(int sensors, int actuators, int hidden, int iterations) {
    super(sensors, actuators);
    this.hidden = hidden;
    this.iterations = iterations;
  }

  static Hebbian read(SpecificationReader reader) {
    return new Hebbian(
        reader.count("sensors", 1, MAX_WEIGHTS),
        reader.count("actuators", 1, MAX_WEIGHTS),
        reader.count("hidden", 0, MAX_WEIGHTS),
        reader.count("iterations", 1, MAX_ITERATIONS));
  }

  private int nodes() {
    return sensors() + hidden + actuators();
  }

  private int links() {
    return (hidden + actuators()) * nodes();
  }

  @Override
  public long weightCount() {
    return plus(1, times((long) hidden + actuators(), nodes() + 1L));
  }

  /** Whether the weights that follow are there yet, the outputs of all nodes, the weights. */
  @Override
  int stateLength() {
    return 1 + nodes() + links();
  }

  @Override
  int scratchLength() {
    return links();
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    int nodes = nodes();
    int links = 1 + nodes;
    int active = nodes - sensors();
    if (state[0] == 0f) {
      state[0] = 1f;
      for (int node = 0; node < active; node++) {
        int bias = first + 1 + node * (nodes + 1);
        System.arraycopy(weights, bias + 1, state, links + node * nodes, nodes);
      }
    }
    System.arraycopy(sensors, 0, state, 1, sensors());
    for (int iteration = 0; iteration < iterations; iteration++) {
      int weight = links;
      for (int node = 0; node < active; node++) {
        float sum = 0f;
        for (int j = 0; j < nodes; j++) {
          sum = sum + state[weight++] * state[1 + j];
        }
        scratch[node] = Activation.CLAMP.apply(weights[first + 1 + node * (nodes + 1)] + sum);
      }
      // All nodes at once: their inputs are the outputs of the iteration before.
      System.arraycopy(scratch, 0, state, 1 + sensors(), active);
    }
    learn(weights[first], state, scratch);
    for (int i = 0; i < actuators.length; i++) {
      actuators[i] = OutputRange.UNIT.actuator(state[1 + sensors() + hidden + i]);
    }
  }

  /** Changes all weights but those of a node to itself, by numbers whose mean is 0. */
  private void learn(float rate, float[] state, float[] deltas) {
    int nodes = nodes();
    int active = nodes - sensors();
    float sum = 0f;
    for (int node = 0; node < active; node++) {
      double half = rate * (state[1 + sensors() + node] - 0.5);
      for (int source = 0; source < nodes; source++) {
        float delta = (float) (half * (state[1 + source] - 0.5));
        deltas[node * nodes + source] = delta;
        if (source != sensors() + node) {
          sum = sum + delta;
        }
      }
    }
    float mean = sum / (active * (nodes - 1));
    for (int node = 0; node < active; node++) {
      for (int source = 0; source < nodes; source++) {
        if (source != sensors() + node) {
          int weight = 1 + nodes + node * nodes + source;
          state[weight] = state[weight] + (deltas[node * nodes + source] - mean);
        }
      }
    }
  }
}
