package org.swarmwright.controllers;

/**
 * The network of EvoStick: no hidden nodes, and outputs that are steep logistic functions. Keeps
 * nothing between steps.
 *
 * <p>Weights: sensor after sensor, one weight for every output, then one for every output's bias.
 */
final strictfp class Evostick extends Architecture {
  /** What a sum is multiplied by before the logistic function. */
  private static final float STEEPNESS = 4.924273f;

  private Evostick(int sensors, int actuators) {
    super(sensors, actuators);
  }

  static Evostick read(SpecificationReader reader) {
    return new Evostick(
        reader.count("sensors", 1, MAX_WEIGHTS), reader.count("actuators", 1, MAX_WEIGHTS));
  }

  @Override
  public long weightCount() {
    return times(actuators(), sensors() + 1L);
  }

  @Override
  String sizeField() {
    return "sensors";
  }

  @Override
  int stateLength() {
    return 0;
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    for (int k = 0; k < actuators.length; k++) {
      int weight = first + k;
      float sum = 0f;
      for (float sensor : sensors) {
        sum = sum + weights[weight] * sensor;
        weight += actuators.length;
      }
      float output = Functions.sigmoid(STEEPNESS * (sum + weights[weight]));
      actuators[k] = OutputRange.UNIT.actuator(output);
    }
  }
}
