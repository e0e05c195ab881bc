package org.swarmwright.controllers;

/**
 * A Mealy machine (G. H. Mealy, "A method for synthesizing sequential circuits", 1955) over
 * thresholded sensors.
 *
 * <p>Weights: row after row of its table: the state of the next step, then one number for every
 * actuator. Rows are in mixed radix: the state is the most significant digit, the interval of the
 * last sensor the least.
 */
final strictfp class MealyFsm extends Architecture {
  private final int states;
  private final float[][] thresholds;

  private MealyFsm(int sensors, int actuators, int states, float[][] thresholds) {
    super(sensors, actuators);
    this.states = states;
    this.thresholds = thresholds;
  }

  static MealyFsm read(SpecificationReader reader) {
    int sensors = reader.count("sensors", 1, MAX_WEIGHTS);
    return new MealyFsm(
        sensors,
        reader.count("actuators", 1, MAX_WEIGHTS),
        reader.count("states", 1, MAX_WEIGHTS),
        reader.thresholds(sensors));
  }

  @Override
  public long weightCount() {
    long rows = states;
    for (float[] ofOne : thresholds) {
      rows = times(rows, ofOne.length + 1L);
    }
    return times(rows, 1L + actuators());
  }

  @Override
  String sizeField() {
    return "thresholds";
  }

  @Override
  int stateLength() {
    return 1;
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    int row = (int) state[0];
    for (int j = 0; j < sensors(); j++) {
      row = row * (thresholds[j].length + 1);
      for (float threshold : thresholds[j]) {
        if (threshold < sensors[j]) {
          row++;
        }
      }
    }
    int weight = first + row * (1 + actuators());
    float last = states - 1;
    float next = weights[weight] < 0f ? 0f : weights[weight];
    state[0] = (int) (next > last ? last : next);
    for (int k = 0; k < actuators.length; k++) {
      float a = weights[weight + 1 + k];
      a = a > 1f ? 1f : a;
      actuators[k] = a < -1f ? -1f : a;
    }
  }
}
