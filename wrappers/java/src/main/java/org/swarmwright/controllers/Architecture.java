package org.swarmwright.controllers;

import com.google.gson.JsonObject;

/** A controller without its weights: how one agent computes actuators from sensors and weights. */
public abstract strictfp class Architecture {
  /** The largest number of weights of a controller. */
  public static final int MAX_WEIGHTS = 1_000_000;

  private static final String KINDS =
      "\"layered\", \"fully_meshed\", \"mealy_fsm\" or \"parameter_set\"";

  private final int sensors;
  private final int actuators;

  Architecture(int sensors, int actuators) {
    this.sensors = sensors;
    this.actuators = actuators;
  }

  /**
   * Reads a specification (protocol/schemas/controller.schema.json); its weights may be missing and
   * are ignored.
   *
   * @throws SpecificationException if a field is missing, unknown, of the wrong type or out of
   *     range
   */
  public static Architecture read(JsonObject specification) {
    SpecificationReader reader = new SpecificationReader(specification);
    reader.count("version", 1, 1);
    String kind = reader.text("kind", KINDS);
    Architecture architecture;
    switch (kind) {
      case "layered":
        architecture = Layered.read(reader);
        break;
      case "fully_meshed":
        architecture = FullyMeshed.read(reader);
        break;
      case "mealy_fsm":
        architecture = MealyFsm.read(reader);
        break;
      case "parameter_set":
        architecture = ParameterSet.read(reader);
        break;
      default:
        throw new SpecificationException("kind", "\"" + kind + "\" found, expected " + KINDS);
    }
    reader.end();
    if (architecture.weightCount() > MAX_WEIGHTS) {
      throw new SpecificationException(
          kind.equals("mealy_fsm") ? "thresholds" : "hidden",
          "makes "
              + architecture.weightCount()
              + " weights; at most "
              + MAX_WEIGHTS
              + " are possible");
    }
    return architecture;
  }

  /** Whether it steers agents; a {@link ParameterSet} does not. */
  public boolean steers() {
    return true;
  }

  /** Number of sensors. */
  public int sensors() {
    return sensors;
  }

  /** Number of actuators. */
  public int actuators() {
    return actuators;
  }

  /** Number of weights, biases included; may be larger than any int. */
  public abstract long weightCount();

  /** Numbers that are kept between steps, all 0 at the start of an episode. */
  abstract int stateLength();

  /** Length of the working memory of a step. */
  abstract int scratchLength();

  /** One step: sensors in, actuators out. {@code first} is the index of the first weight. */
  abstract void step(
      float[] weights,
      int first,
      float[] state,
      float[] scratch,
      float[] sensors,
      float[] actuators);

  /** a * b; Long.MAX_VALUE if that overflows. */
  static long times(long a, long b) {
    try {
      return Math.multiplyExact(a, b);
    } catch (ArithmeticException error) {
      return Long.MAX_VALUE;
    }
  }

  /** a + b; Long.MAX_VALUE if that overflows. */
  static long plus(long a, long b) {
    try {
      return Math.addExact(a, b);
    } catch (ArithmeticException error) {
      return Long.MAX_VALUE;
    }
  }
}
