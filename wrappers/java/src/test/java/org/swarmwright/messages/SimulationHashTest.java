package org.swarmwright.messages;

import static org.junit.jupiter.api.Assertions.assertEquals;

import com.google.gson.JsonObject;
import org.junit.jupiter.api.Test;
import org.swarmwright.Vectors;

class SimulationHashTest {
  @Test
  void hashesAreThoseOfTheVectors() {
    for (JsonObject vector : Vectors.objects(Vectors.load("hashes.json"))) {
      String canonical = SimulationHash.canonical(vector.get("value"));
      assertEquals(
          vector.get("canonical").getAsString(), canonical, vector.get("name").getAsString());
      assertEquals(vector.get("sha256").getAsString(), SimulationHash.sha256(canonical));
    }
  }

  @Test
  void anEpisodeHasItsHash() {
    JsonObject vector = Vectors.objects(Vectors.load("hashes.json")).get(0);
    JsonObject value = vector.getAsJsonObject("value");
    String hash =
        SimulationHash.of(
            value.get("simulation").getAsString(),
            value.getAsJsonObject("parameters"),
            value.get("instance").getAsLong());
    assertEquals(vector.get("sha256").getAsString(), hash);
  }
}
