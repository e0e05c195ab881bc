package org.swarmwright.controllers;

/**
 * A recurrent network whose nodes hear those that a list names (FREVO's NEAT).
 *
 * <p>Nodes: sensors, then hidden, then actuators. Weights: for every node that is not a sensor, in
 * that order: the bias, one weight for each node that it hears, and for an actuator the slope of
 * its sigmoid. Nodes are computed one after the other, in binary64; their outputs stay from step to
 * step.
 */
final strictfp class Neat extends Architecture {
  private static final int MAX_ITERATIONS = 1000;

  /** FastMath of jodk 1.2, which FREVO has: from here on e^x is infinite, and below the other 0. */
  private static final double OVERFLOW = 709.782712893384;

  private static final double UNDERFLOW = -745.1332191019411;
  private static final double LN_2 = 0.6931471805599453;
  private static final double SMALLER = 0x1p-54;

  private final int[][] sources;
  private final int iterations;

  private Neat(int sensors, int actuators, int[][] sources, int iterations) {
    super(sensors, actuators);
    this.sources = sources;
    this.iterations = iterations;
  }

  static Neat read(SpecificationReader reader) {
    int sensors = reader.count("sensors", 1, MAX_WEIGHTS);
    int actuators = reader.count("actuators", 1, MAX_WEIGHTS);
    int[][] sources = reader.lists("sources", sensors);
    if (sources.length < actuators) {
      throw new SpecificationException(
          "sources",
          sources.length
              + " lists found, expected one for each hidden node and each of the "
              + actuators
              + " actuators");
    }
    return new Neat(sensors, actuators, sources, reader.count("iterations", 1, MAX_ITERATIONS));
  }

  @Override
  public long weightCount() {
    long count = actuators();
    for (int[] row : sources) {
      count += 1 + row.length;
    }
    return count;
  }

  @Override
  String sizeField() {
    return "sources";
  }

  /** The bits of the output of each node but the sensors, in two halves. */
  @Override
  int stateLength() {
    return 2 * sources.length;
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    int hidden = sources.length - actuators();
    for (int iteration = 0; iteration < iterations; iteration++) {
      int weight = first;
      for (int node = 0; node < sources.length; node++) {
        double bias = weights[weight++];
        double sum = 0;
        for (int source : sources[node]) {
          double heard = source < sensors() ? sensors[source] : output(state, source - sensors());
          sum = sum + heard * weights[weight++];
        }
        sum = sum + bias;
        keep(state, node, node < hidden ? tanh(sum) : sigmoid(weights[weight++], sum));
      }
    }
    for (int i = 0; i < actuators.length; i++) {
      actuators[i] = OutputRange.UNIT.actuator((float) output(state, hidden + i));
    }
  }

  private static double output(float[] state, int node) {
    long high = Float.floatToRawIntBits(state[2 * node]);
    long low = Float.floatToRawIntBits(state[2 * node + 1]) & 0xFFFF_FFFFL;
    return Double.longBitsToDouble(high << 32 | low);
  }

  private static void keep(float[] state, int node, double output) {
    long bits = Double.doubleToRawLongBits(output);
    state[2 * node] = Float.intBitsToFloat((int) (bits >>> 32));
    state[2 * node + 1] = Float.intBitsToFloat((int) bits);
  }

  private static double tanh(double sum) {
    if (sum < -20 || sum > 20) {
      return sum < 0 ? -1 : 1;
    }
    double e = exp(-2 * sum);
    return (1 - e) / (1 + e);
  }

  private static double sigmoid(float slope, double sum) {
    return 1 / (1 + exp(-(double) slope * sum));
  }

  /** Decision 002: StrictMath.exp is fdlibm's. */
  private static double exp(double x) {
    if (x > OVERFLOW) {
      return Double.POSITIVE_INFINITY;
    }
    if (x < UNDERFLOW) {
      return 0;
    }
    int whole = (int) x;
    int step = (int) (x * 1024) - 1024 * whole;
    double rest = (x - whole) - step * (1.0 / 1024);
    double series = 1 + rest * (1 + rest * (1.0 / 2 + rest * (1.0 / 6 + rest * (1.0 / 24))));
    double fraction = StrictMath.exp(step / 1024.0) * series;
    return whole < -705
        ? StrictMath.exp(54 * LN_2 + whole) * fraction * SMALLER
        : StrictMath.exp(whole) * fraction;
  }
}
