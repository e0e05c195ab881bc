package org.swarmwright.controllers;

/**
 * A probabilistic finite-state machine, or a behaviour tree, of given behaviours and conditions,
 * for robots with two wheels. Its random numbers come from a sensor.
 *
 * <p>Weights: the number of states; for each state its behaviour, rwm, alpha and number of
 * transitions, and for each of these its target, condition, probability, xi and eta.
 * docs/decisions/002-arithmetic.md says what they mean.
 */
final strictfp class Modules extends Architecture {
  private static final int SENSORS = 9;
  private static final int ACTUATORS = 2;
  private static final int MOST_STATES = 16;
  private static final int MOST_TRANSITIONS = 4;
  private static final int OF_STATE = 4;
  private static final int OF_TRANSITION = 5;

  private static final int EXPLORATION = 0;
  private static final int STOP = 1;

  /** Of the light, the neighbours, their square, and obstacles; from behaviour 2 on. */
  private static final float[][] PULLS = {
    {1f, 0f, 0f, -5f}, {-1f, 0f, 0f, -5f}, {0f, 1f, 0f, -6f}, {0f, 0f, -1f, -5f}
  };

  private static final int NEIGHBOURS = 3;
  private static final int FEW_NEIGHBOURS = 4;
  private static final int FIXED = 5;

  private static final float SHORT = 0.1f;
  private static final float BLACK = 0.1f;
  private static final float WHITE = 0.95f;
  private static final float UNIT = 1f / 16777216f;

  private final boolean tree;
  private final int states;
  private final int transitions;

  private Modules(boolean tree, int sensors, int actuators, int states, int transitions) {
    super(sensors, actuators);
    this.tree = tree;
    this.states = states;
    this.transitions = transitions;
  }

  static Modules read(SpecificationReader reader) {
    boolean tree = "tree".equals(reader.choice("form", "machine", "tree"));
    // Each subtree draws a random number of its own.
    int mostStates = tree ? MOST_TRANSITIONS : MOST_STATES;
    int mostTransitions = tree ? 1 : MOST_TRANSITIONS;
    return new Modules(
        tree,
        reader.count("sensors", SENSORS, SENSORS),
        reader.count("actuators", ACTUATORS, ACTUATORS),
        reader.count("states", 1, mostStates),
        reader.count("transitions", 1, mostTransitions));
  }

  private int rowLength() {
    return OF_STATE + transitions * OF_TRANSITION;
  }

  @Override
  public long weightCount() {
    return 1 + (long) states * rowLength();
  }

  @Override
  String sizeField() {
    return "states";
  }

  /**
   * The number of the state, whether it was entered before this step, and how many steps the robot
   * still turns: to the left above 0.
   */
  @Override
  int stateLength() {
    return 3;
  }

  @Override
  void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators) {
    if (tree) {
      tick(weights, first, state, sensors, actuators);
      return;
    }
    int row = first + 1 + (int) state[0] * rowLength();
    int[] words = words(sensors[8]);
    act(weights, row, state, words, sensors, actuators);
    if (state[1] == 0f) {
      state[1] = 1f;
      return;
    }
    int count = Math.min((int) limited(weights[row + 3], 0f, 4f), transitions);
    int[] holding = new int[MOST_TRANSITIONS];
    int held = 0;
    for (int k = 0; k < count; k++) {
      int transition = row + OF_STATE + k * OF_TRANSITION;
      float drawn = (words[k] >>> 8) * UNIT;
      if (drawn < probability(weights, transition, sensors)) {
        holding[held] = transition;
        held++;
      }
    }
    if (held > 0) {
      int chosen = holding[sixteen(words[2], words[3]) * held >>> 16];
      int target = (int) limited(weights[chosen], 0f, 16f);
      int last = (int) limited(weights[first], 1f, states) - 1;
      state[0] = Math.min(target, last);
      state[1] = 0f;
      state[2] = 0f;
    }
  }

  /** A step of a tree: from the subtree of the last step to the first whose condition fails. */
  private void tick(float[] weights, int first, float[] state, float[] sensors, float[] actuators) {
    int[] words = words(sensors[8]);
    int count = (int) limited(weights[first], 1f, states);
    for (int k = (int) state[0]; k < count; k++) {
      int row = first + 1 + k * rowLength();
      float drawn = (words[k] >>> 8) * UNIT;
      if (!(drawn < probability(weights, row + OF_STATE, sensors))) {
        state[0] = k;
        act(weights, row, state, words, sensors, actuators);
        return;
      }
      state[2] = 0f;
    }
    state[0] = 0f;
    state[2] = 0f;
    actuators[0] = 0f;
    actuators[1] = 0f;
  }

  private static void act(
      float[] weights, int row, float[] state, int[] words, float[] sensors, float[] actuators) {
    int behaviour = (int) limited(weights[row], 0f, 5f);
    if (behaviour == EXPLORATION) {
      explore((int) limited(weights[row + 1], 1f, 100f), state, words, sensors, actuators);
    } else if (behaviour == STOP) {
      actuators[0] = 0f;
      actuators[1] = 0f;
    } else {
      float[] pull = PULLS[behaviour - 2];
      float alpha = (int) limited(weights[row + 2], 1f, 5f);
      float neighbours = (pull[1] + pull[2] * alpha) * alpha;
      float x = pull[0] * sensors[2] + neighbours * sensors[6] + pull[3] * sensors[0];
      float y = pull[0] * sensors[3] + neighbours * sensors[7] + pull[3] * sensors[1];
      follow(x, y, actuators);
    }
  }

  private static void explore(
      int rwm, float[] state, int[] words, float[] sensors, float[] actuators) {
    actuators[0] = state[2] > 0f ? -1f : 1f;
    actuators[1] = state[2] < 0f ? -1f : 1f;
    if (state[2] > 0f) {
      state[2] = state[2] - 1f;
    } else if (state[2] < 0f) {
      state[2] = state[2] + 1f;
    } else if (length(sensors[0], sensors[1]) >= SHORT && sensors[0] >= 0f) {
      int steps = Math.max(1, sixteen(words[0], words[1]) * rwm >>> 16);
      state[2] = sensors[1] < 0f ? steps : -steps;
    }
  }

  private static void follow(float x, float y, float[] actuators) {
    float length = length(x, y);
    boolean isShort = length < SHORT;
    float inner = isShort ? 1f : x / length;
    inner = Float.isNaN(inner) ? 0f : limited(inner, -1f, 1f);
    boolean left = !isShort && y > 0f;
    actuators[0] = left ? inner : 1f;
    actuators[1] = left ? 1f : inner;
  }

  private static float probability(float[] weights, int transition, float[] sensors) {
    int condition = (int) limited(weights[transition + 1], 0f, 5f);
    if (condition == NEIGHBOURS || condition == FEW_NEIGHBOURS) {
      float more = sensors[5] - (int) limited(weights[transition + 3], 1f, 10f);
      float eta = limited(weights[transition + 4], 0f, 20f);
      return Functions.sigmoid(eta * (condition == NEIGHBOURS ? more : -more));
    }
    int ground = sensors[4] <= BLACK ? 0 : sensors[4] >= WHITE ? 2 : 1;
    boolean holds = condition == FIXED || condition == ground;
    return holds ? limited(weights[transition + 2], 0f, 1f) : 0f;
  }

  /** The square root is correctly rounded: binary64 has more than twice the bits. */
  private static float length(float x, float y) {
    float square = x * x + y * y;
    return (float) Math.sqrt(square);
  }

  private static float limited(float value, float low, float high) {
    float above = value < low ? low : value;
    return above > high ? high : above;
  }

  /** Four random words by pcg4d from a number in 0..1. */
  private static int[] words(float sensor) {
    int bits = (int) (limited(sensor, 0f, 1f - UNIT) * 16777216f);
    int[] v = {bits, 1, 2, 3};
    for (int i = 0; i < 4; i++) {
      v[i] = v[i] * 1664525 + 1013904223;
    }
    mix(v);
    for (int i = 0; i < 4; i++) {
      v[i] ^= v[i] >>> 16;
    }
    mix(v);
    return v;
  }

  private static void mix(int[] v) {
    v[0] += v[1] * v[3];
    v[1] += v[2] * v[0];
    v[2] += v[0] * v[1];
    v[3] += v[1] * v[2];
  }

  private static int sixteen(int first, int other) {
    return first & 255 | (other & 255) << 8;
  }
}
