package org.swarmwright.messages;

import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import java.math.BigDecimal;
import java.util.ArrayList;
import java.util.List;
import java.util.Map;
import java.util.TreeMap;
import java.util.function.Supplier;

/**
 * The keys of a JSON object, each with the type that it must have. Optional ones give null where
 * they are absent.
 */
final class Fields {
  private static final BigDecimal MAX_ID = BigDecimal.valueOf(Long.MAX_VALUE);

  private final JsonObject object;

  Fields(JsonObject object) {
    this.object = object;
  }

  private MessageException wrong(String key, String expected) {
    String actual = String.valueOf(object.get(key));
    String shown = actual.length() > 60 ? actual.substring(0, 57) + "..." : actual;
    return new MessageException("\"" + key + "\" is " + shown + ", expected " + expected);
  }

  private <T> T required(String key, T value) {
    if (value == null) {
      throw new MessageException("\"" + key + "\" is missing");
    }
    return value;
  }

  private JsonPrimitive primitive(String key, String expected) {
    JsonElement value = object.get(key);
    if (value == null) {
      return null;
    }
    if (!value.isJsonPrimitive()) {
      throw wrong(key, expected);
    }
    return value.getAsJsonPrimitive();
  }

  String optionalText(String key) {
    JsonPrimitive value = primitive(key, "a string");
    if (value != null && !value.isString()) {
      throw wrong(key, "a string");
    }
    return value == null ? null : value.getAsString();
  }

  String text(String key) {
    return required(key, optionalText(key));
  }

  Boolean optionalFlag(String key) {
    JsonPrimitive value = primitive(key, "true or false");
    if (value != null && !value.isBoolean()) {
      throw wrong(key, "true or false");
    }
    return value == null ? null : value.getAsBoolean();
  }

  /** An integer from 0 to 2^63 - 1; 1.0 and 1e3 are integers. */
  long id(String key) {
    String expected = "an integer from 0 to " + Long.MAX_VALUE;
    JsonPrimitive value = required(key, primitive(key, expected));
    if (!value.isNumber() || !Double.isFinite(value.getAsDouble())) {
      throw wrong(key, expected);
    }
    double nearest = value.getAsDouble();
    if (nearest < 0 || nearest > 1e19) {
      throw wrong(key, expected);
    }
    if (nearest != 0 && nearest < 1) {
      throw wrong(key, expected);
    }
    BigDecimal number = new BigDecimal(value.getAsString());
    boolean whole = number.signum() == 0 || number.stripTrailingZeros().scale() <= 0;
    if (!whole || number.compareTo(MAX_ID) > 0) {
      throw wrong(key, expected);
    }
    return number.longValueExact();
  }

  /** A finite binary64. */
  Double optionalNumber(String key) {
    String expected = "a finite number";
    JsonPrimitive value = primitive(key, expected);
    if (value == null) {
      return null;
    }
    if (!value.isNumber() || !Double.isFinite(value.getAsDouble())) {
      throw wrong(key, expected);
    }
    return value.getAsDouble();
  }

  double number(String key) {
    return required(key, optionalNumber(key));
  }

  /** Numbers, each rounded once to the nearest binary32, at least one. */
  List<Double> singles(String key) {
    String expected = "a list of finite numbers";
    JsonArray values = required(key, array(key, expected));
    if (values.isEmpty()) {
      throw new MessageException("\"" + key + "\" is empty");
    }
    List<Double> numbers = new ArrayList<>(values.size());
    for (JsonElement value : values) {
      if (!value.isJsonPrimitive() || !value.getAsJsonPrimitive().isNumber()) {
        throw wrong(key, expected);
      }
      float number = Float.parseFloat(value.getAsString());
      if (!Float.isFinite(number)) {
        throw wrong(key, expected + " within binary32");
      }
      numbers.add((double) number);
    }
    return numbers;
  }

  /** The finite numbers of an extension's object; null if it is missing, empty or not an object. */
  Map<String, Double> numbers(String key) {
    JsonElement value = object.get(key);
    Map<String, Double> numbers = new TreeMap<>();
    if (value != null && value.isJsonObject()) {
      Fields inner = new Fields(value.getAsJsonObject());
      for (String name : value.getAsJsonObject().keySet()) {
        Double number = lenient(() -> inner.optionalNumber(name));
        if (number != null) {
          numbers.put(name, number);
        }
      }
    }
    return numbers.isEmpty() ? null : numbers;
  }

  List<String> optionalTexts(String key) {
    String expected = "a list of strings";
    JsonArray values = array(key, expected);
    if (values == null) {
      return null;
    }
    List<String> texts = new ArrayList<>(values.size());
    for (JsonElement value : values) {
      if (!value.isJsonPrimitive() || !value.getAsJsonPrimitive().isString()) {
        throw wrong(key, expected);
      }
      texts.add(value.getAsString());
    }
    return texts;
  }

  List<Fields> optionalObjects(String key) {
    String expected = "a list of objects";
    JsonArray values = array(key, expected);
    if (values == null) {
      return null;
    }
    List<Fields> objects = new ArrayList<>(values.size());
    for (JsonElement value : values) {
      if (!value.isJsonObject()) {
        throw wrong(key, expected);
      }
      objects.add(new Fields(value.getAsJsonObject()));
    }
    return objects;
  }

  /** At least one. */
  List<String> texts(String key) {
    List<String> texts = required(key, optionalTexts(key));
    if (texts.isEmpty()) {
      throw new MessageException("\"" + key + "\" is empty");
    }
    return texts;
  }

  Fields object(String key) {
    JsonElement value = required(key, object.get(key));
    if (!value.isJsonObject()) {
      throw wrong(key, "an object");
    }
    return new Fields(value.getAsJsonObject());
  }

  /** A key of an extension: if another peer uses its name for something else, it is ignored. */
  <T> T lenient(Supplier<T> read) {
    try {
      return read.get();
    } catch (MessageException error) {
      return null;
    }
  }

  boolean has(String key) {
    return object.has(key);
  }

  private JsonArray array(String key, String expected) {
    JsonElement value = object.get(key);
    if (value == null) {
      return null;
    }
    if (!value.isJsonArray()) {
      throw wrong(key, expected);
    }
    return value.getAsJsonArray();
  }
}
