package org.swarmwright.extension;

import static org.junit.jupiter.api.Assertions.assertArrayEquals;
import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import com.google.gson.JsonArray;
import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import java.util.ArrayList;
import java.util.List;
import java.util.Locale;
import java.util.Map;
import java.util.TreeMap;
import java.util.stream.Stream;
import org.junit.jupiter.api.DynamicTest;
import org.junit.jupiter.api.TestFactory;
import org.swarmwright.Vectors;
import org.swarmwright.messages.MessageException;

/** What a server reads is read, and what it writes is written, as the vectors say. */
class ExtensionTest {
  private static List<JsonObject> vectors(String topic) {
    List<JsonObject> messages = new ArrayList<>();
    for (JsonObject vector : Vectors.objects(Vectors.load("extension.json"))) {
      if (vector.get("topic").getAsString().equals(topic)) {
        messages.add(vector);
      }
    }
    return messages;
  }

  @TestFactory
  Stream<DynamicTest> requestsAreReadAsTheVectorsSay() {
    List<JsonObject> vectors = vectors("to_server");
    assertTrue(vectors.size() >= 50, "vectors are missing");
    return vectors.stream()
        .map(
            vector ->
                DynamicTest.dynamicTest(
                    vector.get("name").getAsString(), () -> checkRequest(vector)));
  }

  private static void checkRequest(JsonObject vector) {
    byte[] payload = Vectors.payload(vector);
    if (!vector.get("accept").getAsBoolean()) {
      assertThrows(MessageException.class, () -> ToServer.read(payload));
      return;
    }
    JsonObject expected = vector.getAsJsonObject("reading");
    JsonObject actual = reading(ToServer.read(payload));
    for (String key : expected.keySet()) {
      if (!key.equals("kind") && !key.equals("version")) {
        assertEquals(plain(expected.get(key)), plain(actual.get(key)), key);
      }
    }
  }

  /** 60 and 60.0 are one number. */
  private static String plain(JsonElement value) {
    if (value.isJsonObject()) {
      Map<String, String> parts = new TreeMap<>();
      value
          .getAsJsonObject()
          .entrySet()
          .forEach(entry -> parts.put(entry.getKey(), plain(entry.getValue())));
      return parts.toString();
    }
    if (value.isJsonArray()) {
      List<String> parts = new ArrayList<>();
      value.getAsJsonArray().forEach(item -> parts.add(plain(item)));
      return parts.toString();
    }
    boolean number = value.isJsonPrimitive() && value.getAsJsonPrimitive().isNumber();
    return number ? value.getAsBigDecimal().stripTrailingZeros().toPlainString() : value.toString();
  }

  private static JsonObject reading(ToServer message) {
    JsonObject reading = new JsonObject();
    reading.add("request", unsigned(message.request()));
    if (message instanceof BatchActuators) {
      BatchActuators actuators = (BatchActuators) message;
      reading.add("step", unsigned(actuators.step));
      reading.add("actuators", texts(Vectors.hex(actuators.actuators)));
      return reading;
    }
    Request request = (Request) message;
    reading.addProperty("tool", request.tool);
    reading.addProperty("reply", request.reply);
    reading.addProperty("simulation", request.simulation);
    reading.addProperty("instance", request.instance);
    if (message instanceof Evaluate) {
      Evaluate evaluate = (Evaluate) message;
      reading.add("parameters", evaluate.parameters);
      reading.add("controller", evaluate.controller);
      reading.add("genomes", texts(Vectors.hex(evaluate.genomes)));
      reading.add("seeds", seeds(evaluate.seeds));
      reading.add("metrics", texts(evaluate.metrics));
      reading.addProperty("attempt", evaluate.attempt);
      reading.addProperty("lease", evaluate.lease);
    } else {
      BatchStart start = (BatchStart) message;
      reading.add("parameters", start.parameters);
      reading.add("seeds", seeds(start.seeds));
      reading.add("metrics", texts(start.metrics));
    }
    return reading;
  }

  private static JsonElement unsigned(long bits) {
    return new JsonPrimitive(new java.math.BigInteger(Long.toUnsignedString(bits)));
  }

  private static JsonArray texts(List<String> texts) {
    JsonArray array = new JsonArray();
    texts.forEach(array::add);
    return array;
  }

  private static JsonArray seeds(long[] seeds) {
    JsonArray array = new JsonArray();
    for (long seed : seeds) {
      array.add(String.format("%016x", seed));
    }
    return array;
  }

  @TestFactory
  Stream<DynamicTest> answersAreWrittenAsTheVectorsSay() {
    List<JsonObject> canonical = new ArrayList<>();
    for (JsonObject vector : vectors("to_tool")) {
      if (vector.has("canonical")) {
        canonical.add(vector);
      }
    }
    assertTrue(canonical.size() >= 14, "vectors are missing");
    return canonical.stream()
        .map(
            vector ->
                DynamicTest.dynamicTest(
                    vector.get("name").getAsString(), () -> checkAnswer(vector)));
  }

  private static void checkAnswer(JsonObject vector) {
    JsonObject reading = vector.getAsJsonObject("reading");
    boolean evaluated = reading.get("kind").getAsString().equals("evaluated");
    boolean failed = reading.get("kind").getAsString().equals("failed");
    byte[] written = evaluated ? evaluated(reading) : failed ? failed(reading) : sensors(reading);
    assertArrayEquals(Vectors.payload(vector), written);
  }

  private static byte[] failed(JsonObject reading) {
    return Answers.failed(
        new Failed(
            bits(reading, "server"),
            reading.get("simulation_hash").getAsString(),
            reading.get("reason").getAsString(),
            stack(reading),
            reading.get("invalid").getAsBoolean()));
  }

  private static String stack(JsonObject reading) {
    return reading.get("stack").isJsonNull() ? null : reading.get("stack").getAsString();
  }

  private static byte[] evaluated(JsonObject reading) {
    Map<String, double[]> metrics = new TreeMap<>();
    for (Map.Entry<String, JsonElement> metric : reading.getAsJsonObject("metrics").entrySet()) {
      metrics.put(metric.getKey(), doubles(metric.getValue()));
    }
    return Answers.evaluated(
        bits(reading, "request"),
        bits(reading, "server"),
        doubles(reading.get("fitness")),
        metrics,
        failures(reading),
        refusal(reading),
        reading.get("seconds").getAsDouble());
  }

  private static byte[] sensors(JsonObject reading) {
    BatchSensors message =
        new BatchSensors(
            bits(reading, "request"),
            bits(reading, "server"),
            bits(reading, "step"),
            refusal(reading));
    ints(reading.get("episodes"), message.episodes);
    ints(reading.get("agents"), message.agents);
    for (float sensor : Vectors.singles(reading.get("sensors"))) {
      message.sensors.add(sensor);
    }
    ints(reading.get("ended"), message.ended);
    for (double fitness : doubles(reading.get("fitness"))) {
      message.fitness.add(fitness);
    }
    for (Map.Entry<String, JsonElement> metric : reading.getAsJsonObject("metrics").entrySet()) {
      Block block = new Block();
      for (double value : doubles(metric.getValue())) {
        block.add(value);
      }
      message.metrics.put(metric.getKey(), block);
    }
    message.failed.addAll(failures(reading));
    return Answers.sensors(message);
  }

  private static long bits(JsonObject reading, String key) {
    return reading.get(key).getAsBigInteger().longValue();
  }

  private static double[] doubles(JsonElement list) {
    return Vectors.texts(list).stream()
        .mapToDouble(hex -> Double.longBitsToDouble(Long.parseUnsignedLong(hex, 16)))
        .toArray();
  }

  private static void ints(JsonElement list, Block block) {
    Vectors.texts(list).forEach(hex -> block.add(Integer.parseUnsignedInt(hex, 16)));
  }

  private static List<Failure> failures(JsonObject reading) {
    List<Failure> failures = new ArrayList<>();
    for (JsonObject failure : Vectors.objects(reading.get("failed"))) {
      failures.add(
          new Failure(
              bits(failure, "candidate"),
              bits(failure, "episode"),
              failure.get("reason").getAsString(),
              stack(failure)));
    }
    return failures;
  }

  private static Refusal refusal(JsonObject reading) {
    if (reading.get("error").isJsonNull()) {
      return null;
    }
    JsonObject error = reading.getAsJsonObject("error");
    Refusal.Kind kind =
        Refusal.Kind.valueOf(error.get("kind").getAsString().toUpperCase(Locale.ROOT));
    return new Refusal(kind, error.get("reason").getAsString());
  }
}
