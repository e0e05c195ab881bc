package org.swarmwright.controllers;

import java.util.Arrays;

/**
 * A feed-forward network: sensors, any number of hidden layers, actuators. Keeps nothing between
 * steps.
 *
 * <p>Weights: layer after layer, node after node: the bias, then one weight for every output of the
 * layer below. The activation applies to every layer, to the last one only where {@code
 * output_activation} is left out.
 */
final strictfp class Layered extends Architecture {
  private final int[] layers;
  private final Activation activation;
  private final Activation outputActivation;
  private final OutputRange outputRange;

  private Layered(
      int sensors,
      int actuators,
      int[] hidden,
      Activation activation,
      Activation outputActivation,
      OutputRange outputRange) {
    super(sensors, actuators);
    layers = Arrays.copyOf(hidden, hidden.length + 1);
    layers[hidden.length] = actuators;
    this.activation = activation;
    this.outputActivation = outputActivation;
    this.outputRange = outputRange;
  }

  static Layered read(SpecificationReader reader) {
    int sensors = reader.count("sensors", 1, MAX_WEIGHTS);
    int actuators = reader.count("actuators", 1, MAX_WEIGHTS);
    int[] hidden = reader.counts("hidden", 1, MAX_WEIGHTS);
    Activation activation = reader.activation(Activation.values());
    Activation last = reader.outputActivation(activation);
    return new Layered(sensors, actuators, hidden, activation, last, reader.outputRange());
  }

  @Override
  public long weightCount() {
    long below = sensors();
    long count = 0;
    for (int nodes : layers) {
      count = plus(count, times(nodes, below + 1));
      below = nodes;
    }
    return count;
  }

  @Override
  int stateLength() {
    return 0;
  }

  private int widest() {
    int widest = sensors();
    for (int nodes : layers) {
      widest = Math.max(widest, nodes);
    }
    return widest;
  }

  /** The outputs of two neighbouring layers. */
  @Override
  int scratchLength() {
    return 2 * widest();
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    int below = 0;
    int above = scratch.length / 2;
    int width = sensors();
    int weight = first;
    System.arraycopy(sensors, 0, scratch, 0, width);
    for (int layer = 0; layer < layers.length; layer++) {
      int nodes = layers[layer];
      Activation function = layer == layers.length - 1 ? outputActivation : activation;
      for (int node = 0; node < nodes; node++) {
        float bias = weights[weight++];
        float sum = 0f;
        for (int j = 0; j < width; j++) {
          sum = sum + weights[weight++] * scratch[below + j];
        }
        scratch[above + node] = function.apply(bias + sum);
      }
      int old = below;
      below = above;
      above = old;
      width = nodes;
    }
    for (int i = 0; i < actuators.length; i++) {
      actuators[i] = outputRange.actuator(scratch[below + i]);
    }
  }
}
