package org.swarmwright.minisim;

import static org.junit.jupiter.api.Assertions.assertArrayEquals;
import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import com.google.gson.JsonObject;
import com.google.gson.JsonParser;
import java.util.Arrays;
import java.util.Collections;
import java.util.List;
import java.util.stream.Stream;
import org.junit.jupiter.api.DynamicTest;
import org.junit.jupiter.api.Test;
import org.junit.jupiter.api.TestFactory;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.Vectors;
import org.swarmwright.controllers.Architecture;
import org.swarmwright.controllers.Controller;

class MinisimTest {
  private static final JsonObject VECTORS = Vectors.load("minisim.json").getAsJsonObject();

  @TestFactory
  Stream<DynamicTest> episodesGiveTheBitsOfTheVectors() {
    return Vectors.objects(VECTORS.get("episodes")).stream()
        .map(
            vector ->
                DynamicTest.dynamicTest(
                    vector.get("name").getAsString(), () -> checkEpisode(vector)));
  }

  private static void checkEpisode(JsonObject vector) {
    Minisim minisim = new Minisim();
    minisim.reset(new ParameterReader(vector.getAsJsonObject("parameters")));
    float[] sensors = new float[4];
    for (JsonObject step : Vectors.objects(vector.get("steps"))) {
      assertEquals(
          step.get("acting").toString().replace(",", ", "), Arrays.toString(minisim.acting()));
      for (int i = 0; i < minisim.acting().length; i++) {
        minisim.sense(minisim.acting()[i], sensors);
        assertEquals(
            Vectors.texts(step.getAsJsonArray("sensor_bits").get(i)), Vectors.hex(sensors));
      }
      minisim.step(Vectors.singles(step.get("actuator_bits")));
    }
    assertTrue(minisim.done());
    checkEnd(vector.getAsJsonObject("end"), minisim);
  }

  private static void checkEnd(JsonObject end, Minisim minisim) {
    double fitness = Double.parseDouble(end.get("fitness_hex").getAsString());
    assertEquals(
        Double.doubleToRawLongBits(fitness), Double.doubleToRawLongBits(minisim.fitness()));
    List<String> states = Vectors.texts(end.get("states"));
    double[] metrics = minisim.metrics();
    assertEquals(Collections.frequency(states, "arrived"), metrics[0]);
    assertEquals(Collections.frequency(states, "caught"), metrics[1]);
    assertEquals(end.get("steps").getAsDouble(), metrics[2]);
  }

  @TestFactory
  Stream<DynamicTest> rolloutsGiveTheBitsOfTheVectors() {
    return Vectors.objects(VECTORS.get("rollouts")).stream()
        .map(
            vector ->
                DynamicTest.dynamicTest(
                    vector.get("name").getAsString(), () -> checkRollout(vector)));
  }

  private static void checkRollout(JsonObject vector) {
    JsonObject specification = vector.getAsJsonObject("controller");
    Architecture architecture = Architecture.read(specification);
    float[] weights = Vectors.weights(specification);
    Minisim minisim = new Minisim();
    minisim.reset(new ParameterReader(vector.getAsJsonObject("parameters")));
    Controller[] controllers = new Controller[minisim.acting().length];
    Arrays.setAll(controllers, i -> new Controller(architecture, weights, 0));
    float[] sensors = new float[4];
    float[] row = new float[1];
    while (!minisim.done()) {
      int[] acting = minisim.acting();
      float[] actuators = new float[acting.length];
      for (int i = 0; i < acting.length; i++) {
        minisim.sense(acting[i], sensors);
        controllers[acting[i]].step(sensors, row);
        actuators[i] = row[0];
      }
      minisim.step(actuators);
    }
    checkEnd(vector.getAsJsonObject("end"), minisim);
  }

  @Test
  void whatIsMeasuredHasItsName() {
    Minisim minisim = new Minisim();
    assertEquals(
        List.of("arrived", "caught", "steps", "distance"), minisim.description().metrics());
    minisim.step(new float[] {0f});
    assertArrayEquals(new double[] {0, 0, 1, 11}, minisim.metrics());
  }

  @Test
  void parametersThatCannotBeUsedAreNamed() {
    refuses(
        "parameter mapWidth: 0 found, expected a whole number from 1 to 1000000",
        "{\"mapWidth\": 0}");
    refuses(
        "parameter mapWidth: \"13\" (a string) found, expected a whole number from 1 to 1000000",
        "{\"mapWidth\": \"13\"}");
    refuses(
        "parameter agents[0]: [99,1] found, expected a position inside the map, [0, 0] to [13.0,"
            + " 7.0]",
        "{\"agents\": [[99, 1]]}");
    refuses(
        "parameter agents: 1 positions found, but numAgents is 2; make them agree or leave one out",
        "{\"agents\": [[1, 1]], \"numAgents\": 2}");
    refuses(
        "parameter placement: \"odd\" (a string) found, expected one of \"fixed\", \"random\"",
        "{\"placement\": \"odd\"}");
    refuses(
        "parameter speedAgents: -1 found, expected a finite number of at least 0",
        "{\"speedAgents\": -1}");
  }

  private static void refuses(String message, String parameters) {
    ParameterReader reader =
        new ParameterReader(JsonParser.parseString(parameters).getAsJsonObject());
    ParameterException error =
        assertThrows(ParameterException.class, () -> new Minisim().reset(reader));
    assertEquals(message, error.getMessage());
  }

  @Test
  void thePictureShowsWhoIsWhere() {
    String[] lines = new Minisim().picture().split("\n");
    assertEquals("Welcome to minisim, step 0", lines[0]);
    assertEquals("A.......D...X", lines[4]);
    assertEquals(8, lines.length);
  }
}
