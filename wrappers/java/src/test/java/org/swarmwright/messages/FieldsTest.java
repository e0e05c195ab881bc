package org.swarmwright.messages;

import static org.junit.jupiter.api.Assertions.assertDoesNotThrow;
import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonParser;
import java.nio.charset.StandardCharsets;
import java.util.List;
import java.util.Map;
import java.util.Set;
import java.util.function.Function;
import java.util.stream.Stream;
import org.junit.jupiter.api.DynamicTest;
import org.junit.jupiter.api.TestFactory;
import org.swarmwright.Vectors;
import org.swarmwright.extension.ToServer;

/**
 * Replays protocol/vectors/fields.json, which is made from the schemas: every field is there,
 * missing, mistyped.
 */
class FieldsTest {
  private static final Map<String, Function<byte[], Object>> READERS =
      Map.of(
          "discovery", Messages::readDiscovery,
          "server", Messages::readServer,
          "parameters", Messages::readParameters,
          "control", Messages::readControl,
          "sensor", Messages::readSensor,
          "actuator", Messages::readActuator,
          "fitness", Messages::readFitness,
          "presence", Messages::readPresence,
          "to_server", ToServer::read);

  /** Servers do not read what other servers send to tools, nor the status of tools. */
  private static final Set<String> NOT_READ = Set.of("to_tool", "status");

  @TestFactory
  Stream<DynamicTest> messagesAreAcceptedOrRefusedAsTheSchemasDemand() {
    List<JsonObject> vectors = Vectors.objects(Vectors.load("fields.json"));
    assertTrue(vectors.size() >= 300, "vectors are missing");
    return vectors.stream()
        .filter(vector -> !NOT_READ.contains(vector.get("topic").getAsString()))
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
    Object message = assertDoesNotThrow(() -> reader.apply(payload));
    if (vector.has("written") && vector.has("text")) {
      String written = new String(Messages.write(message), StandardCharsets.UTF_8);
      assertEquals(numbers(payload(vector)), numbers(JsonParser.parseString(written)));
    }
  }

  private static JsonElement payload(JsonObject vector) {
    return JsonParser.parseString(vector.get("text").getAsString());
  }

  /** A copy in which 2 and 2.0 are one number. */
  private static JsonElement numbers(JsonElement value) {
    String text = value.toString().replaceAll("(?<=[:\\[,]-?[0-9]{1,18})\\.0(?=[,\\]}])", "");
    return JsonParser.parseString(text);
  }
}
