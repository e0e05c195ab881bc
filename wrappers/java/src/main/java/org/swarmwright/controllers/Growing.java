package org.swarmwright.controllers;

import java.util.Arrays;

/**
 * NEAT's network with room to grow.
 *
 * <p>Nodes: sensors, the bias, whose output is 1, actuators, then hidden nodes. Weights: the number
 * of hidden nodes; for each actuator its number of inputs; for each hidden node its innovation
 * number, activation and number of inputs; for each connection its source, weight, and whether it
 * is enabled. Connections are in the order of their targets, the hidden ones first.
 */
final strictfp class Growing extends Architecture {
  private static final int OF_NODE = 3;
  private static final int OF_CONNECTION = 3;
  private static final float STEEPNESS = 4.924273f;

  /** Activations by their numbers in a genome; the first one is steep. */
  private static final String[] ACTIVATIONS = {
    "steep_sigmoid", "tanh", "sigmoid", "relu", "clamp", "linear"
  };

  private final int nodes;
  private final int connections;
  private final boolean recurrent;
  private final int outputActivation;
  private final OutputRange outputRange;

  private Growing(
      int sensors,
      int actuators,
      int nodes,
      int connections,
      boolean recurrent,
      int outputActivation,
      OutputRange outputRange) {
    super(sensors, actuators);
    this.nodes = nodes;
    this.connections = connections;
    this.recurrent = recurrent;
    this.outputActivation = outputActivation;
    this.outputRange = outputRange;
  }

  static Growing read(SpecificationReader reader) {
    return new Growing(
        reader.count("sensors", 1, MAX_WEIGHTS),
        reader.count("actuators", 1, MAX_WEIGHTS),
        reader.count("nodes", 0, MAX_WEIGHTS),
        reader.count("connections", 1, MAX_WEIGHTS),
        reader.flag("recurrent"),
        reader.number("output_activation", ACTIVATIONS),
        reader.outputRange());
  }

  @Override
  public long weightCount() {
    return 1L + actuators() + (long) OF_NODE * nodes + (long) OF_CONNECTION * connections;
  }

  @Override
  String sizeField() {
    return "connections";
  }

  /** The outputs of actuators and hidden nodes; twice if they are computed from those before. */
  @Override
  int stateLength() {
    return (actuators() + nodes) * (recurrent ? 2 : 1);
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    int hidden = limited(weights[first], nodes);
    int computed = actuators() + nodes;
    int used = actuators() + hidden;
    int written = recurrent ? computed : 0;
    if (!recurrent) {
      Arrays.fill(state, 0, used, 0f);
    }
    int gene = first + 1 + actuators();
    int connection = gene + OF_NODE * nodes;
    int end = connection + OF_CONNECTION * connections;
    for (int rank = 0; rank < used; rank++) {
      boolean isActuator = rank >= hidden;
      int node = isActuator ? rank - hidden : actuators() + rank;
      float inputs = isActuator ? weights[first + 1 + node] : weights[gene + OF_NODE * rank + 2];
      int count = limited(inputs, (end - connection) / OF_CONNECTION);
      float sum = 0f;
      for (int i = 0; i < count; i++) {
        if (limited(weights[connection + 2], 1) == 1) {
          int source = limited(weights[connection], sensors() + used) - sensors();
          float input =
              source < 0 ? sensors[source + sensors()] : source == 0 ? 1f : state[source - 1];
          sum = sum + weights[connection + 1] * input;
        }
        connection += OF_CONNECTION;
      }
      int activation =
          isActuator
              ? outputActivation
              : limited(weights[gene + OF_NODE * rank + 1], ACTIVATIONS.length - 1);
      state[written + node] = apply(activation, sum);
    }
    if (recurrent) {
      System.arraycopy(state, computed, state, 0, used);
    }
    for (int i = 0; i < actuators.length; i++) {
      actuators[i] = outputRange.actuator(state[i]);
    }
  }

  private static float apply(int activation, float sum) {
    return activation == 0
        ? Functions.sigmoid(STEEPNESS * sum)
        : Activation.values()[activation - 1].apply(sum);
  }

  /** The whole part of a number, limited to 0..highest. */
  private static int limited(float number, int highest) {
    return Math.min(Math.max((int) number, 0), highest);
  }
}
