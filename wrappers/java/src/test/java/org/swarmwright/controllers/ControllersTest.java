package org.swarmwright.controllers;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import com.google.gson.JsonElement;
import com.google.gson.JsonObject;
import com.google.gson.JsonParser;
import java.util.ArrayList;
import java.util.List;
import java.util.Map;
import java.util.function.DoubleUnaryOperator;
import java.util.stream.Stream;
import org.junit.jupiter.api.DynamicTest;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.api.TestFactory;
import org.swarmwright.Vectors;

class ControllersTest {
  private static final JsonObject VECTORS = Vectors.load("controllers.json").getAsJsonObject();
  private static final Map<String, DoubleUnaryOperator> FUNCTIONS =
      Map.of(
          "tanh", x -> Functions.tanh((float) x),
          "sigmoid", x -> Functions.sigmoid((float) x),
          "sin_pi", x -> Functions.sinPi((float) x),
          "cos_pi", x -> Functions.cosPi((float) x));

  @TestFactory
  Stream<DynamicTest> functionsGiveTheBitsOfTheVectors() {
    JsonObject functions = VECTORS.getAsJsonObject("functions");
    return functions.keySet().stream()
        .map(name -> DynamicTest.dynamicTest(name, () -> checkFunction(name, functions.get(name))));
  }

  private static void checkFunction(String name, JsonElement rows) {
    assertTrue(rows.getAsJsonArray().size() >= 100, "vectors are missing");
    for (JsonElement row : rows.getAsJsonArray()) {
      float x = Vectors.single(row.getAsJsonArray().get(1));
      float y = (float) FUNCTIONS.get(name).applyAsDouble(x);
      assertEquals(row.getAsJsonArray().get(3).getAsString(), Vectors.hex(y), name + "(" + x + ")");
    }
  }

  @TestFactory
  Stream<DynamicTest> controllersGiveTheBitsOfTheVectors() {
    return Vectors.objects(VECTORS.get("controllers")).stream()
        .map(
            vector ->
                DynamicTest.dynamicTest(
                    vector.get("name").getAsString(), () -> checkController(vector)));
  }

  private static void checkController(JsonObject vector) {
    JsonObject specification = vector.getAsJsonObject("specification");
    Architecture architecture = Architecture.read(specification);
    // Behind other weights, as in a block of genomes.
    float[] weightsOfVector = Vectors.weights(specification);
    float[] weights = new float[weightsOfVector.length + 3];
    System.arraycopy(weightsOfVector, 0, weights, 2, weightsOfVector.length);
    assertEquals(weightsOfVector.length, architecture.weightCount());
    Controller controller = new Controller(architecture, weights, 2);
    float[] actuators = new float[architecture.actuators()];
    for (JsonObject step : Vectors.objects(vector.get("steps"))) {
      if (step.get("reset").getAsBoolean()) {
        controller.reset();
      }
      controller.step(Vectors.singles(step.get("sensor_bits")), actuators);
      assertEquals(Vectors.texts(step.get("actuator_bits")), Vectors.hex(actuators));
    }
  }

  @TestFactory
  Stream<DynamicTest> parameterSetsBecomeTheParametersOfTheVectors() {
    return Vectors.objects(VECTORS.get("parameter_sets")).stream()
        .map(
            vector ->
                DynamicTest.dynamicTest(
                    vector.get("name").getAsString(), () -> checkParameters(vector)));
  }

  private static void checkParameters(JsonObject vector) {
    JsonObject specification = vector.getAsJsonObject("specification");
    ParameterSet set = (ParameterSet) Architecture.read(specification);
    float[] weights = Vectors.weights(specification);
    assertEquals(
        vector.get("merged"), set.merged(vector.getAsJsonObject("parameters"), weights, 0));
  }

  @Test
  void kindsAreThoseOfTheSchema() {
    List<String> kinds = new ArrayList<>();
    for (JsonElement kind : Vectors.schema("controller").getAsJsonArray("oneOf")) {
      String reference = kind.getAsJsonObject().get("$ref").getAsString();
      kinds.add(reference.substring(reference.lastIndexOf('/') + 1));
    }
    assertTrue(kinds.remove("team")); // controllers of these kinds, for groups of agents
    assertEquals(kinds, Architecture.kinds());
    SpecificationException error =
        assertThrows(
            SpecificationException.class,
            () -> Architecture.read(object("'version': 1, 'kind': 'spiking'")));
    kinds.forEach(kind -> assertTrue(error.getMessage().contains(kind), error.getMessage()));
  }

  @Test
  void whatIsNoSpecificationIsRefusedWithTheNameOfTheField() {
    String layered =
        "'version': 1, 'kind': 'layered', 'sensors': 4, 'actuators': 1, 'hidden': [8],"
            + " 'activation': 'tanh', 'output_range': [-1, 1]";
    assertEquals(49, Architecture.read(object(layered)).weightCount());
    refuses("controller.kind: ", layered.replace("layered", "spiking"));
    refuses("controller.sensors: ", layered.replace("'sensors': 4", "'sensors': 4.5"));
    refuses("controller.hidden[0]: ", layered.replace("[8]", "[0]"));
    refuses("controller.hidden: ", layered.replace("[8]", "[1000000, 1000000]"));
    refuses("controller.output_range: ", layered.replace("[-1, 1]", "[1, -1]"));
    refuses("controller.colour: ", layered + ", 'colour': 'red'");
    refuses("controller.activation: ", layered.replace("tanh", "softmax"));
    refuses("controller.version: ", layered.replace("'version': 1", "'version': 2"));
    refuses("controller.hidden: is missing", layered.replace("'hidden': [8], ", ""));
  }

  private static void refuses(String beginning, String fields) {
    SpecificationException error =
        assertThrows(SpecificationException.class, () -> Architecture.read(object(fields)), fields);
    assertTrue(error.getMessage().startsWith(beginning), error.getMessage());
  }

  private static JsonObject object(String fields) {
    return JsonParser.parseString("{" + fields.replace('\'', '"') + "}").getAsJsonObject();
  }
}
