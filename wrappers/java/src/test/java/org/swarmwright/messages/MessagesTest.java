package org.swarmwright.messages;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonParser;
import java.math.BigDecimal;
import java.nio.charset.StandardCharsets;
import java.util.HashSet;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.function.Function;
import java.util.stream.Stream;
import org.junit.jupiter.api.DynamicTest;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.api.TestFactory;
import org.swarmwright.Vectors;

class MessagesTest {
  private static final Map<String, Function<byte[], Object>> READERS =
      Map.of(
          "discovery", Messages::readDiscovery,
          "server", Messages::readServer,
          "parameters", Messages::readParameters,
          "control", Messages::readControl,
          "sensor", Messages::readSensor,
          "actuator", Messages::readActuator,
          "fitness", Messages::readFitness,
          "presence", Messages::readPresence);

  @TestFactory
  Stream<DynamicTest> messagesAreReadAsTheVectorsSay() {
    List<JsonObject> vectors = Vectors.objects(Vectors.load("messages.json"));
    assertTrue(vectors.size() >= 189, "vectors are missing");
    return vectors.stream()
        .map(
            vector ->
                DynamicTest.dynamicTest(vector.get("name").getAsString(), () -> check(vector)));
  }

  private static void check(JsonObject vector) {
    Function<byte[], Object> reader = READERS.get(vector.get("topic").getAsString());
    byte[] payload = Vectors.payload(vector);
    if (!vector.get("accept").getAsBoolean()) {
      assertThrows(MessageException.class, () -> reader.apply(payload));
      return;
    }
    Object message = reader.apply(payload);
    JsonObject written = tree(message);
    compare("", vector.get("reading"), written);
    assertEquals(written, tree(reader.apply(Messages.write(message))), "written and read again");
    if (vector.has("binary32")) {
      List<String> bits = Vectors.texts(vector.get("binary32"));
      List<Double> numbers = ((Sensor) message).getSensor();
      for (int i = 0; i < bits.size(); i++) {
        assertEquals(bits.get(i), Vectors.hex(numbers.get(i).floatValue()));
      }
    }
  }

  /** The message as the vectors write it: parameters are gathered. */
  private static JsonObject tree(Object message) {
    String text = new String(Messages.write(message), StandardCharsets.UTF_8);
    JsonObject tree = JsonParser.parseString(text).getAsJsonObject();
    if (message instanceof Parameters) {
      tree = new JsonObject();
      tree.addProperty("server", ((Parameters) message).getServer());
      tree.addProperty("simulation_hash", ((Parameters) message).getSimulationHash());
      tree.add("parameters", Messages.problem((Parameters) message));
    }
    return tree;
  }

  /** Every key that is expected; null and nothing are one, and so are an empty list or object. */
  private static void compare(String where, JsonElement expected, JsonElement actual) {
    if (expected.isJsonNull() || actual == null) {
      boolean nothing =
          expected.isJsonNull()
              || expected.isJsonArray() && expected.getAsJsonArray().isEmpty()
              || expected.isJsonObject() && expected.getAsJsonObject().entrySet().isEmpty();
      assertTrue(nothing, where + " is missing, expected " + expected);
      assertTrue(
          actual == null || actual.isJsonNull() || actual.toString().equals("[]"),
          where + " is " + actual);
    } else if (expected.isJsonObject()) {
      Set<String> keys = new HashSet<>(expected.getAsJsonObject().keySet());
      for (String key : keys) {
        compare(
            where + "." + key,
            expected.getAsJsonObject().get(key),
            actual.getAsJsonObject().get(key));
      }
    } else if (expected.isJsonArray()) {
      assertEquals(expected.getAsJsonArray().size(), actual.getAsJsonArray().size(), where);
      for (int i = 0; i < expected.getAsJsonArray().size(); i++) {
        compare(
            where + "[" + i + "]",
            expected.getAsJsonArray().get(i),
            actual.getAsJsonArray().get(i));
      }
    } else if (actual.getAsJsonPrimitive().isNumber()) {
      // Gson, which reads the vectors, takes some long integers for texts.
      assertTrue(expected.getAsString().matches("[-+.eE0-9]+"), where);
      same(where, expected.getAsString(), actual.getAsString());
    } else {
      assertEquals(expected, actual, where);
    }
  }

  private static void same(String where, String expected, String actual) {
    boolean exact = new BigDecimal(expected).compareTo(new BigDecimal(actual)) == 0;
    boolean near =
        Double.parseDouble(expected) == Double.parseDouble(actual)
            && !expected.matches("-?[0-9]{16,}");
    boolean single = where.contains("sensor") || where.contains("actuator");
    boolean nearSingle = single && Float.parseFloat(expected) == Float.parseFloat(actual);
    assertTrue(exact || near || nearSingle, where + " is " + actual + ", expected " + expected);
  }

  @Test
  void numbersAreWrittenAsTheShortestDecimals() {
    Sensor sensor = new Sensor().withSimulationHash("h").withAgent(0L);
    sensor.setSensor(List.of((double) 0.33f, 2.0, (double) 1.0E-3f, -0.0, (double) 3.4028235E38f));
    assertEquals(
        "{\"simulation_hash\":\"h\",\"agent\":0,\"sensor\":[0.33,2,0.001,-0.0,3.4028235E38]}",
        new String(Messages.write(sensor), StandardCharsets.UTF_8));
    Fitness fitness = new Fitness().withSimulationHash("h").withFitness((double) 0.33f);
    assertEquals(
        "{\"simulation_hash\":\"h\",\"fitness\":0.33000001311302185}",
        new String(Messages.write(fitness), StandardCharsets.UTF_8));
  }

  @Test
  void numbersThatAreNoneAreNotSent() {
    Fitness fitness = new Fitness().withSimulationHash("h").withFitness(Double.NaN);
    assertThrows(MessageException.class, () -> Messages.write(fitness));
  }
}
