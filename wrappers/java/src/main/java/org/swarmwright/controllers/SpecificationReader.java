package org.swarmwright.controllers;

import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.HashSet;
import java.util.List;
import java.util.Set;
import java.util.stream.Collectors;

/** Reads the fields of a specification one by one, so that every error names its field. */
final class SpecificationReader {
  /**
   * Keys of a parameters message that are not parameters of the simulation, and the seed, which
   * differs from episode to episode.
   */
  private static final Set<String> RESERVED =
      Set.of("server", "simulation", "simulation_hash", "seed");

  private final JsonObject fields;
  private final Set<String> knownFields = new HashSet<>(Set.of("weights"));

  SpecificationReader(JsonObject fields) {
    this.fields = fields;
  }

  private JsonElement take(String field, String expected) {
    knownFields.add(field);
    JsonElement value = fields.get(field);
    if (value == null) {
      throw new SpecificationException(field, "is missing; expected " + expected);
    }
    return value;
  }

  private static SpecificationException wrong(String field, JsonElement value, String expected) {
    String text = value.toString();
    String shown = text.length() <= 40 ? text : text.substring(0, 37) + "...";
    return new SpecificationException(field, shown + " found, expected " + expected);
  }

  String text(String field, String expected) {
    JsonElement value = take(field, expected);
    if (!value.isJsonPrimitive() || !value.getAsJsonPrimitive().isString()) {
      throw wrong(field, value, expected);
    }
    return value.getAsString();
  }

  /** One of the texts allowed; the first one where the field is left out. */
  String choice(String field, String... allowed) {
    if (!fields.has(field)) {
      knownFields.add(field);
      return allowed[0];
    }
    String expected = "one of " + String.join(", ", allowed);
    String name = text(field, expected);
    if (!Arrays.asList(allowed).contains(name)) {
      throw new SpecificationException(field, "\"" + name + "\" found, expected " + expected);
    }
    return name;
  }

  /** The index of a text among those allowed. */
  int number(String field, String... allowed) {
    String expected = "one of " + String.join(", ", allowed);
    int index = Arrays.asList(allowed).indexOf(text(field, expected));
    if (index < 0) {
      throw new SpecificationException(field, "expected " + expected);
    }
    return index;
  }

  boolean flag(String field) {
    String expected = "true or false";
    JsonElement value = take(field, expected);
    if (!value.isJsonPrimitive() || !value.getAsJsonPrimitive().isBoolean()) {
      throw wrong(field, value, expected);
    }
    return value.getAsBoolean();
  }

  /** A whole number in low..high; 8.0 counts as 8. */
  int count(String field, int low, int high) {
    String expected = low == high ? "" + low : "a whole number from " + low + " to " + high;
    return whole(field, take(field, expected), low, high, expected);
  }

  int[] counts(String field, int low, int high) {
    String expected = "a list of whole numbers from " + low + " to " + high;
    JsonArray values = array(field, take(field, expected), expected);
    int[] counts = new int[values.size()];
    for (int i = 0; i < counts.length; i++) {
      counts[i] =
          whole(
              field + "[" + i + "]",
              values.get(i),
              low,
              high,
              "a whole number from " + low + " to " + high);
    }
    return counts;
  }

  Activation activation(Activation... allowed) {
    return function("activation", allowed);
  }

  /** The function of the output layer: that of all nodes where the field is left out. */
  Activation outputActivation(Activation ofAll) {
    String field = "output_activation";
    knownFields.add(field);
    return fields.has(field) ? function(field, Activation.values()) : ofAll;
  }

  private Activation function(String field, Activation... allowed) {
    String expected =
        "one of " + Arrays.stream(allowed).map(Activation::text).collect(Collectors.joining(", "));
    String name = text(field, expected);
    for (Activation activation : allowed) {
      if (activation.text().equals(name)) {
        return activation;
      }
    }
    throw new SpecificationException(field, "\"" + name + "\" found, expected " + expected);
  }

  OutputRange outputRange() {
    String expected = "[low, high] with low < high, such as [-1, 1] or [0, 1]";
    JsonElement value = take("output_range", expected);
    JsonArray pair = array("output_range", value, expected);
    OutputRange range =
        pair.size() == 2 ? OutputRange.of(single(pair.get(0)), single(pair.get(1))) : null;
    if (range == null) {
      throw wrong("output_range", value, expected);
    }
    return range;
  }

  /** A list for each sensor, of finite binary32 numbers, ascending. */
  float[][] thresholds(int sensors) {
    String expected =
        "a list of " + sensors + " lists of ascending numbers, such as [[-0.5, 0.5], [0]]";
    JsonElement value = take("thresholds", expected);
    JsonArray lists = array("thresholds", value, expected);
    if (lists.size() != sensors) {
      throw wrong("thresholds", value, expected);
    }
    float[][] thresholds = new float[sensors][];
    for (int i = 0; i < sensors; i++) {
      JsonArray list = array("thresholds", lists.get(i), expected);
      thresholds[i] = new float[list.size()];
      for (int j = 0; j < thresholds[i].length; j++) {
        float threshold = single(list.get(j));
        if (!Float.isFinite(threshold) || j > 0 && !(thresholds[i][j - 1] < threshold)) {
          throw new SpecificationException(
              "thresholds[" + i + "]",
              "must hold finite binary32 numbers, each greater than the one before");
        }
        thresholds[i][j] = threshold;
      }
    }
    return thresholds;
  }

  /** Lists of whole numbers from 0 to the number of lists and {@code more}, less 1. */
  int[][] lists(String field, int more) {
    String expected = "a list of lists of whole numbers";
    JsonArray lists = array(field, take(field, expected), expected);
    int highest = (int) Math.min(Integer.MAX_VALUE, (long) lists.size() + more - 1);
    int[][] numbers = new int[lists.size()][];
    for (int i = 0; i < numbers.length; i++) {
      JsonArray list = array(field, lists.get(i), expected);
      numbers[i] = new int[list.size()];
      for (int j = 0; j < numbers[i].length; j++) {
        numbers[i][j] =
            whole(
                field + "[" + i + "][" + j + "]",
                list.get(j),
                0,
                highest,
                "a whole number from 0 to " + highest);
      }
    }
    return numbers;
  }

  /** At least one parameter: a unique name, a type, and choices if it is categorical. */
  List<ParameterSet.Parameter> parameters(int max) {
    String expected = "a list of parameters such as {\"name\": \"range\", \"type\": \"real\"}";
    JsonArray items = array("parameters", take("parameters", expected), expected);
    if (items.isEmpty() || items.size() > max) {
      throw new SpecificationException("parameters", items.size() + " found, expected 1 to " + max);
    }
    List<ParameterSet.Parameter> parameters = new ArrayList<>();
    Set<String> names = new HashSet<>();
    for (int i = 0; i < items.size(); i++) {
      String field = "parameters[" + i + "]";
      if (!items.get(i).isJsonObject()) {
        throw wrong(
            field, items.get(i), "an object such as {\"name\": \"range\", \"type\": \"real\"}");
      }
      SpecificationReader item = new SpecificationReader(items.get(i).getAsJsonObject());
      String name = item.text("name", "a text");
      String type = item.text("type", "real, integer or categorical");
      List<String> choices = type.equals("categorical") ? item.choices() : List.of();
      item.knownFields.remove("weights");
      item.end();
      if (name.isEmpty() || RESERVED.contains(name)) {
        throw new SpecificationException(
            field, "\"" + name + "\" cannot be the name of a parameter");
      }
      if (!names.add(name)) {
        throw new SpecificationException(field, "\"" + name + "\" is there twice");
      }
      if (!List.of("real", "integer", "categorical").contains(type)) {
        throw new SpecificationException(
            field, "type: \"" + type + "\" found, expected one of real, integer, categorical");
      }
      parameters.add(new ParameterSet.Parameter(name, type, choices));
    }
    return parameters;
  }

  private List<String> choices() {
    String expected = "a list of texts";
    List<String> choices = new ArrayList<>();
    for (JsonElement choice : array("choices", take("choices", expected), expected)) {
      if (!choice.isJsonPrimitive() || !choice.getAsJsonPrimitive().isString()) {
        throw wrong("choices", choice, "a text");
      }
      choices.add(choice.getAsString());
    }
    if (choices.isEmpty()) {
      throw new SpecificationException("choices", "is empty; expected " + expected);
    }
    return choices;
  }

  /**
   * Checks that all fields have been read.
   *
   * @throws SpecificationException if there is another one
   */
  void end() {
    for (String field : fields.keySet()) {
      if (!knownFields.contains(field)) {
        knownFields.remove("weights");
        throw new SpecificationException(
            field, "is unknown; expected " + String.join(", ", knownFields));
      }
    }
  }

  private static JsonArray array(String field, JsonElement value, String expected) {
    if (!value.isJsonArray()) {
      throw wrong(field, value, expected);
    }
    return value.getAsJsonArray();
  }

  private static int whole(String field, JsonElement value, int low, int high, String expected) {
    boolean number = value.isJsonPrimitive() && value.getAsJsonPrimitive().isNumber();
    double count = number ? value.getAsDouble() : Double.NaN;
    if (!(count >= low && count <= high && count == Math.rint(count))) {
      throw wrong(field, value, expected);
    }
    return (int) count;
  }

  /** The binary32 nearest to a decimal, rounded once; NaN if the value is not a number. */
  private static float single(JsonElement value) {
    boolean number = value.isJsonPrimitive() && value.getAsJsonPrimitive().isNumber();
    return number ? value.getAsFloat() : Float.NaN;
  }
}
