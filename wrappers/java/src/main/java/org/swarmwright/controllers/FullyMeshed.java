package org.swarmwright.controllers;

/**
 * A recurrent network in which every node hears every node (FREVO's FullyMeshedNet).
 *
 * <p>Nodes: sensors, then hidden, then actuators. Weights: for every node that is not a sensor, in
 * that order: the bias, then one weight from every node, itself included. The outputs of all nodes
 * stay from step to step.
 */
final strictfp class FullyMeshed extends Architecture {
  private static final int MAX_ITERATIONS = 1000;

  private final int hidden;
  private final Activation activation;
  private final int iterations;
  private final OutputRange outputRange;

  private FullyMeshed(
      int sensors,
      int actuators,
      int hidden,
      Activation activation,
      int iterations,
      OutputRange outputRange) {
    super(sensors, actuators);
    this.hidden = hidden;
    this.activation = activation;
    this.iterations = iterations;
    this.outputRange = outputRange;
  }

  static FullyMeshed read(SpecificationReader reader) {
    return new FullyMeshed(
        reader.count("sensors", 1, MAX_WEIGHTS),
        reader.count("actuators", 1, MAX_WEIGHTS),
        reader.count("hidden", 0, MAX_WEIGHTS),
        reader.activation(Activation.CLAMP, Activation.SIGMOID, Activation.TANH, Activation.RELU),
        reader.count("iterations", 1, MAX_ITERATIONS),
        reader.outputRange());
  }

  private int nodes() {
    return sensors() + hidden + actuators();
  }

  @Override
  public long weightCount() {
    return times((long) hidden + actuators(), nodes() + 1L);
  }

  @Override
  int stateLength() {
    return nodes();
  }

  @Override
  int scratchLength() {
    return nodes();
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
    System.arraycopy(sensors, 0, state, 0, sensors());
    for (int iteration = 0; iteration < iterations; iteration++) {
      int weight = first;
      for (int node = sensors(); node < nodes; node++) {
        float bias = weights[weight++];
        float sum = 0f;
        for (int j = 0; j < nodes; j++) {
          sum = sum + weights[weight++] * state[j];
        }
        scratch[node] = activation.apply(bias + sum);
      }
      // All nodes at once: their inputs are the outputs of the iteration before.
      System.arraycopy(scratch, sensors(), state, sensors(), nodes - sensors());
    }
    for (int i = 0; i < actuators.length; i++) {
      actuators[i] = outputRange.actuator(state[sensors() + hidden + i]);
    }
  }
}
