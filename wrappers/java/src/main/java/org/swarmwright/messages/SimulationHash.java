package org.swarmwright.messages;

import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import java.math.BigDecimal;
import java.nio.charset.StandardCharsets;
import java.security.MessageDigest;
import java.security.NoSuchAlgorithmException;
import java.util.Map;
import java.util.TreeMap;

/**
 * The hash that tells an episode from others: SHA-256 of the canonical JSON (RFC 8785).
 * Optimization tools make it.
 */
public final class SimulationHash {
  private SimulationHash() {}

  /**
   * The hash of one episode, 64 hexadecimal digits.
   *
   * @param instance a number below 2^53 that no other episode has
   */
  public static String of(String simulation, JsonObject parameters, long instance) {
    JsonObject whole = new JsonObject();
    whole.addProperty("simulation", simulation);
    whole.add("parameters", parameters);
    whole.addProperty("instance", instance);
    return sha256(canonical(whole));
  }

  /** SHA-256 of a text in UTF-8, hexadecimal. */
  static String sha256(String text) {
    try {
      byte[] digest =
          MessageDigest.getInstance("SHA-256").digest(text.getBytes(StandardCharsets.UTF_8));
      StringBuilder hex = new StringBuilder();
      for (byte b : digest) {
        hex.append(Character.forDigit(b >> 4 & 15, 16)).append(Character.forDigit(b & 15, 16));
      }
      return hex.toString();
    } catch (NoSuchAlgorithmException error) {
      throw new IllegalStateException("every Java has SHA-256", error);
    }
  }

  /** The canonical JSON: keys in order of UTF-16, numbers as ECMAScript writes them. */
  static String canonical(JsonElement value) {
    StringBuilder text = new StringBuilder();
    write(value, text);
    return text.toString();
  }

  private static void write(JsonElement value, StringBuilder text) {
    if (value.isJsonObject()) {
      Map<String, JsonElement> sorted = new TreeMap<>();
      value
          .getAsJsonObject()
          .entrySet()
          .forEach(entry -> sorted.put(entry.getKey(), entry.getValue()));
      String separator = "{";
      for (Map.Entry<String, JsonElement> entry : sorted.entrySet()) {
        quote(entry.getKey(), text.append(separator));
        write(entry.getValue(), text.append(':'));
        separator = ",";
      }
      text.append(sorted.isEmpty() ? "{}" : "}");
    } else if (value.isJsonArray()) {
      JsonArray array = value.getAsJsonArray();
      text.append('[');
      for (int i = 0; i < array.size(); i++) {
        write(array.get(i), text.append(i == 0 ? "" : ","));
      }
      text.append(']');
    } else if (value.isJsonNull()) {
      text.append("null");
    } else {
      write(value.getAsJsonPrimitive(), text);
    }
  }

  private static void write(JsonPrimitive value, StringBuilder text) {
    if (value.isString()) {
      quote(value.getAsString(), text);
    } else if (value.isBoolean()) {
      text.append(value.getAsBoolean());
    } else {
      text.append(ecmaScript(value.getAsDouble()));
    }
  }

  /** Number::toString of ECMA-262: no exponent from 1e-6 up to below 1e21. */
  private static String ecmaScript(double number) {
    if (number == 0) {
      return "0";
    }
    BigDecimal decimal = new BigDecimal(Decimals.shortest(number)).stripTrailingZeros();
    int exponent = decimal.precision() - decimal.scale() - 1;
    if (exponent >= -6 && exponent < 21) {
      return decimal.toPlainString();
    }
    String digits = decimal.unscaledValue().abs().toString();
    String fraction = digits.length() > 1 ? "." + digits.substring(1) : "";
    String sign = number < 0 ? "-" : "";
    return sign + digits.charAt(0) + fraction + "e" + (exponent > 0 ? "+" : "") + exponent;
  }

  private static void quote(String value, StringBuilder text) {
    text.append('"');
    for (char c : value.toCharArray()) {
      int index = "\b\t\n\f\r\"\\".indexOf(c);
      if (index >= 0) {
        text.append('\\').append("btnfr\"\\".charAt(index));
      } else if (c < 0x20) {
        text.append(String.format("\\u%04x", (int) c));
      } else {
        text.append(c);
      }
    }
    text.append('"');
  }
}
