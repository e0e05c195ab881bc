package org.swarmwright;

import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import java.math.BigDecimal;
import java.math.BigInteger;
import java.util.Arrays;
import java.util.HashSet;
import java.util.Set;
import java.util.TreeSet;

/**
 * Parameters of an episode, each read with its type, range and default.
 *
 * <p>All methods throw {@link ParameterException} if the experiment sets a value that is not valid.
 */
public final class ParameterReader {
  private static final BigInteger MIN_SEED = BigInteger.valueOf(Long.MIN_VALUE);
  private static final BigInteger MAX_SEED = BigInteger.ONE.shiftLeft(64).subtract(BigInteger.ONE);

  private final JsonObject parameters;
  private final Set<String> readNames = new HashSet<>();

  /** Reads from a JSON object. */
  public ParameterReader(JsonObject parameters) {
    this.parameters = parameters;
  }

  /** All parameters as JSON, for values that the other methods cannot read. */
  public JsonObject json() {
    readNames.addAll(parameters.keySet());
    return parameters;
  }

  /** Whether the experiment sets a parameter. */
  public boolean has(String name) {
    return asked(name) != null;
  }

  /**
   * The names that the experiment sets and that no method was asked for so far, except the seed:
   * most likely they are misspelt. None after {@link #json}.
   */
  public Set<String> unread() {
    Set<String> names = new TreeSet<>(parameters.keySet());
    names.removeAll(readNames);
    names.remove("seed");
    return names;
  }

  private JsonElement asked(String name) {
    readNames.add(name);
    return parameters.get(name);
  }

  /** A whole number in low..high; 13.0 counts as 13. */
  public int integer(String name, int low, int high, int absent) {
    return (int) whole(name, low, high, absent);
  }

  /** As {@link #integer}, for numbers beyond its range. */
  public long whole(String name, long low, long high, long absent) {
    JsonElement value = asked(name);
    if (value == null) {
      return absent;
    }
    BigInteger number = whole(value);
    boolean fits =
        number != null
            && number.compareTo(BigInteger.valueOf(low)) >= 0
            && number.compareTo(BigInteger.valueOf(high)) <= 0;
    if (!fits) {
      throw mismatch(name, value, "a whole number from " + low + " to " + high);
    }
    return number.longValueExact();
  }

  /** The 64 bits of a seed, 0 if absent: any whole number from -2^63 to 2^64 - 1. */
  public long seed(String name) {
    JsonElement value = asked(name);
    if (value == null) {
      return 0;
    }
    BigInteger number = whole(value);
    if (number == null || number.compareTo(MIN_SEED) < 0 || number.compareTo(MAX_SEED) > 0) {
      throw mismatch(name, value, "a whole number of at most 64 bits");
    }
    return number.longValue();
  }

  /** A finite number in low..high. */
  public double number(String name, double low, double high, double absent) {
    JsonElement value = asked(name);
    if (value == null) {
      return absent;
    }
    double number = real(value);
    if (!(number >= low && number <= high)) {
      throw mismatch(name, value, "a number from " + low + " to " + high);
    }
    return number;
  }

  /** A finite number of at least 0, rounded to binary32. */
  public float notNegative(String name, float absent) {
    JsonElement value = asked(name);
    if (value == null) {
      return absent;
    }
    float number = (float) real(value);
    if (!(number >= 0 && Float.isFinite(number))) {
      throw mismatch(name, value, "a finite number of at least 0");
    }
    return number;
  }

  /** A text. */
  public String text(String name, String absent) {
    JsonElement value = asked(name);
    if (value == null) {
      return absent;
    }
    if (!value.isJsonPrimitive() || !value.getAsJsonPrimitive().isString()) {
      throw mismatch(name, value, "a string");
    }
    return value.getAsString();
  }

  /** True or false. */
  public boolean flag(String name, boolean absent) {
    JsonElement value = asked(name);
    if (value == null) {
      return absent;
    }
    if (!value.isJsonPrimitive() || !value.getAsJsonPrimitive().isBoolean()) {
      throw mismatch(name, value, "true or false");
    }
    return value.getAsBoolean();
  }

  /** One of several texts, the first of them if absent. */
  public String choice(String name, String... choices) {
    JsonElement value = asked(name);
    if (value == null) {
      return choices[0];
    }
    boolean text = value.isJsonPrimitive() && value.getAsJsonPrimitive().isString();
    if (!text || !Arrays.asList(choices).contains(value.getAsString())) {
      throw mismatch(name, value, "one of \"" + String.join("\", \"", choices) + "\"");
    }
    return value.getAsString();
  }

  /**
   * A position [x, y] in 0..width and 0..height, borders included, rounded to binary32; null if
   * absent.
   */
  public float[] position(String name, float width, float height) {
    JsonElement value = asked(name);
    return value == null ? null : position(name, value, width, height);
  }

  /** At most {@code most} positions [[x, y], ..], as {@link #position}; null if absent. */
  public float[][] positions(String name, int most, float width, float height) {
    JsonElement value = asked(name);
    if (value == null) {
      return null;
    }
    if (!value.isJsonArray()) {
      throw mismatch(name, value, "a list of positions [[x, y], ..]");
    }
    JsonArray list = value.getAsJsonArray();
    if (list.size() > most) {
      throw new ParameterException(
          name, list.size() + " positions found, at most " + most + " are possible");
    }
    float[][] positions = new float[list.size()][];
    for (int i = 0; i < positions.length; i++) {
      positions[i] = position(name + "[" + i + "]", list.get(i), width, height);
    }
    return positions;
  }

  private static float[] position(String name, JsonElement value, float width, float height) {
    boolean pair = value.isJsonArray() && value.getAsJsonArray().size() == 2;
    float x = pair ? (float) real(value.getAsJsonArray().get(0)) : Float.NaN;
    float y = pair ? (float) real(value.getAsJsonArray().get(1)) : Float.NaN;
    if (!Float.isFinite(x) || !Float.isFinite(y)) {
      throw mismatch(name, value, "a position [x, y] of two numbers");
    }
    if (!(x >= 0 && x <= width && y >= 0 && y <= height)) {
      throw mismatch(
          name, value, "a position inside the map, [0, 0] to [" + width + ", " + height + "]");
    }
    return new float[] {x, y};
  }

  /** The number; NaN if the value is not a number. */
  private static double real(JsonElement value) {
    boolean number = value.isJsonPrimitive() && value.getAsJsonPrimitive().isNumber();
    return number ? value.getAsDouble() : Double.NaN;
  }

  /** The whole number; null if the value is not a whole number. */
  private static BigInteger whole(JsonElement value) {
    double nearest = real(value);
    if (!(Math.abs(nearest) < 1e20) || nearest != 0 && Math.abs(nearest) < 1) {
      return null;
    }
    JsonPrimitive primitive = value.getAsJsonPrimitive();
    BigDecimal exact = new BigDecimal(primitive.getAsString());
    try {
      return exact.toBigIntegerExact();
    } catch (ArithmeticException error) {
      return null;
    }
  }

  private static ParameterException mismatch(String name, JsonElement value, String expected) {
    String text = value.toString();
    String shown = text.length() <= 40 ? text : text.substring(0, 37) + "...";
    boolean string = value.isJsonPrimitive() && value.getAsJsonPrimitive().isString();
    return new ParameterException(
        name, shown + (string ? " (a string)" : "") + " found, expected " + expected);
  }
}
