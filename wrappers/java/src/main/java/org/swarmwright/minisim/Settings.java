package org.swarmwright.minisim;

import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;

/**
 * Parameters of Minisim, checked, with the positions at the start. The defaults are the example of
 * D6.1.
 */
final strictfp class Settings {
  static final int MAX_BODIES = 100_000;
  private static final int MAX_EXTENT = 1_000_000;
  private static final int MAX_STEP_SIZE = 3_600_000;
  private static final long AGENT_STREAM = 0;
  private static final long DEFENDER_STREAM = 1;

  final float width;
  final float height;
  final float speedAgents;
  final float speedDefenders;
  final float[][] agents;
  final float[][] defenders;
  final float[] goal;
  final String helloMessage;
  final int stepSize;
  final long maxSteps;
  final float captureRadius;
  final float goalRadius;

  /** The rule by which agents steer themselves; null if controllers steer them. */
  final Rule rule;

  Settings(ParameterReader read) {
    width = read.integer("mapWidth", 1, MAX_EXTENT, 13);
    height = read.integer("mapHeight", 1, MAX_EXTENT, 7);
    long seed = read.seed("seed");
    boolean random = read.choice("placement", "fixed", "random").equals("random");
    float[][] listed = listed(read, "agents", "numAgents", 1);
    agents =
        listed != null ? listed : agents(read.integer("numAgents", 1, MAX_BODIES, 1), random, seed);
    listed = listed(read, "defenders", "numDefenders", 0);
    defenders =
        listed != null
            ? listed
            : defenders(read.integer("numDefenders", 0, MAX_BODIES, 1), random, seed);
    speedAgents = read.notNegative("speedAgents", 1f);
    speedDefenders = read.notNegative("speedDefenders", 0.33f);
    float[] position = read.position("goal", width, height);
    goal = position != null ? position : new float[] {width - 0.5f, height / 2f};
    helloMessage = read.text("helloMessage", "Welcome to minisim");
    stepSize = read.integer("stepSize", 0, MAX_STEP_SIZE, 250);
    maxSteps = read.whole("maxSteps", 1, 10_000_000L, 15);
    captureRadius = read.notNegative("captureRadius", 0.5f);
    goalRadius = read.notNegative("goalRadius", 0.5f);
    Rule steering = new Rule(read);
    rule = read.choice("steering", "controller", "rule").equals("rule") ? steering : null;
  }

  private float[][] listed(ParameterReader read, String list, String number, int least) {
    float[][] positions = read.positions(list, MAX_BODIES, width, height);
    if (positions == null) {
      return null;
    }
    if (positions.length < least) {
      throw new ParameterException(
          list, "an empty list found, expected at least one position [x, y]");
    }
    int count = read.integer(number, least, MAX_BODIES, positions.length);
    if (count != positions.length) {
      throw new ParameterException(
          list,
          positions.length
              + " positions found, but "
              + number
              + " is "
              + count
              + "; make them agree or leave one out");
    }
    return positions;
  }

  /** Fixed: x = 0.5. Random: x = u * (mapWidth / 3), y = v * mapHeight. */
  private float[][] agents(int count, boolean random, long seed) {
    float[][] places = new float[count][];
    for (int i = 0; i < count; i++) {
      if (random) {
        float x = uniform(seed, AGENT_STREAM, 2L * i) * (width / 3f);
        places[i] = new float[] {x, uniform(seed, AGENT_STREAM, 2L * i + 1) * height};
      } else {
        places[i] = new float[] {0.5f, spread(i, count)};
      }
    }
    return places;
  }

  /**
   * Fixed: x = mapWidth * 8 / 13. Random: x = mapWidth / 3 + u * (mapWidth / 3), y = v * mapHeight.
   */
  private float[][] defenders(int count, boolean random, long seed) {
    float[][] places = new float[count][];
    float third = width / 3f;
    for (int i = 0; i < count; i++) {
      if (random) {
        float x = third + uniform(seed, DEFENDER_STREAM, 2L * i) * third;
        places[i] = new float[] {x, uniform(seed, DEFENDER_STREAM, 2L * i + 1) * height};
      } else {
        places[i] = new float[] {width * 8f / 13f, spread(i, count)};
      }
    }
    return places;
  }

  /** Evenly from bottom to top. */
  private float spread(int i, int count) {
    return (float) (i + 1) * height / (float) (count + 1);
  }

  /** SplitMix64 (Steele, Lea and Flood 2014): the output for the state x. */
  private static long splitmix(long x) {
    long z = x + 0x9E3779B97F4A7C15L;
    z = (z ^ (z >>> 30)) * 0xBF58476D1CE4E5B9L;
    z = (z ^ (z >>> 27)) * 0x94D049BB133111EBL;
    return z ^ (z >>> 31);
  }

  /** A binary32 in 0..1, a multiple of 2^-24, that depends on a counter alone. */
  private static float uniform(long seed, long stream, long index) {
    long bits = splitmix(splitmix(splitmix(seed) ^ stream) ^ index);
    return (float) (bits >>> 40) / 16_777_216f;
  }
}
