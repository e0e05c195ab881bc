package org.swarmwright.controllers;

import com.google.gson.JsonObject;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.function.Function;

/** A controller without its weights: how one agent computes actuators from sensors and weights. */
public abstract strictfp class Architecture {
  /** The largest number of weights of a controller. */
  public static final int MAX_WEIGHTS = 1_000_000;

  /** How a specification of each kind is read; all lists of kinds follow from this one. */
  private static final Map<String, Function<SpecificationReader, Architecture>> KINDS =
      new LinkedHashMap<>();

  static {
    KINDS.put("layered", Layered::read);
    KINDS.put("fully_meshed", FullyMeshed::read);
    KINDS.put("mealy_fsm", MealyFsm::read);
    KINDS.put("evostick", Evostick::read);
    KINDS.put("hebbian", Hebbian::read);
    KINDS.put("neat", Neat::read);
    KINDS.put("growing", Growing::read);
    KINDS.put("modules", Modules::read);
    KINDS.put("parameter_set", ParameterSet::read);
  }

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
    String expected = "one of \"" + String.join("\", \"", kinds()) + "\"";
    String kind = reader.text("kind", expected);
    if (!KINDS.containsKey(kind)) {
      throw new SpecificationException("kind", "\"" + kind + "\" found, expected " + expected);
    }
    Architecture architecture = KINDS.get(kind).apply(reader);
    reader.end();
    if (architecture.weightCount() > MAX_WEIGHTS) {
      throw new SpecificationException(
          architecture.sizeField(),
          "makes "
              + architecture.weightCount()
              + " weights; at most "
              + MAX_WEIGHTS
              + " are possible");
    }
    return architecture;
  }

  /** The kinds of controller that this library computes, as in specifications. */
  public static List<String> kinds() {
    return List.copyOf(KINDS.keySet());
  }

  /** The field that decides on the number of weights. */
  String sizeField() {
    return "hidden";
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
  int scratchLength() {
    return 0;
  }

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
