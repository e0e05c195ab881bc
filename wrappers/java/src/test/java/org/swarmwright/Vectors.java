package org.swarmwright;

import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonParser;
import java.io.IOException;
import java.io.UncheckedIOException;
import java.nio.charset.StandardCharsets;
import java.nio.file.Files;
import java.nio.file.Path;
import java.util.ArrayList;
import java.util.Base64;
import java.util.List;

/** The golden vectors of protocol/vectors. */
public final class Vectors {
  private static final Path FOLDER = Path.of(System.getProperty("protocol"), "vectors");

  private Vectors() {}

  public static byte[] bytes(String file) {
    try {
      return Files.readAllBytes(FOLDER.resolve(file));
    } catch (IOException error) {
      throw new UncheckedIOException(error);
    }
  }

  public static JsonElement load(String file) {
    return JsonParser.parseString(new String(bytes(file), StandardCharsets.UTF_8));
  }

  /** A schema of protocol/schemas. */
  public static JsonObject schema(String name) {
    Path file = FOLDER.resolveSibling("schemas").resolve(name + ".schema.json");
    try {
      return JsonParser.parseString(Files.readString(file)).getAsJsonObject();
    } catch (IOException error) {
      throw new UncheckedIOException(error);
    }
  }

  /** The objects of a list. */
  public static List<JsonObject> objects(JsonElement list) {
    List<JsonObject> objects = new ArrayList<>();
    list.getAsJsonArray().forEach(item -> objects.add(item.getAsJsonObject()));
    return objects;
  }

  /** The payload of a vector. */
  public static byte[] payload(JsonObject vector) {
    if (vector.has("text")) {
      return vector.get("text").getAsString().getBytes(StandardCharsets.UTF_8);
    }
    return vector.has("bytes")
        ? Base64.getDecoder().decode(vector.get("bytes").getAsString())
        : bytes(vector.get("file").getAsString());
  }

  /** A binary32 from its bits, hexadecimal. */
  public static float single(JsonElement bits) {
    return Float.intBitsToFloat(Integer.parseUnsignedInt(bits.getAsString(), 16));
  }

  public static float[] singles(JsonElement list) {
    float[] numbers = new float[list.getAsJsonArray().size()];
    for (int i = 0; i < numbers.length; i++) {
      numbers[i] = single(list.getAsJsonArray().get(i));
    }
    return numbers;
  }

  public static String hex(float number) {
    return String.format("%08x", Float.floatToRawIntBits(number));
  }

  public static List<String> hex(float[] numbers) {
    List<String> bits = new ArrayList<>();
    for (float number : numbers) {
      bits.add(hex(number));
    }
    return bits;
  }

  public static List<String> texts(JsonElement list) {
    List<String> texts = new ArrayList<>();
    list.getAsJsonArray().forEach(item -> texts.add(item.getAsString()));
    return texts;
  }

  /** The weights of a specification, each the binary32 nearest to its decimal. */
  public static float[] weights(JsonObject specification) {
    List<String> decimals = texts(specification.get("weights"));
    float[] weights = new float[decimals.size()];
    for (int i = 0; i < weights.length; i++) {
      weights[i] = Float.parseFloat(decimals.get(i));
    }
    return weights;
  }
}
