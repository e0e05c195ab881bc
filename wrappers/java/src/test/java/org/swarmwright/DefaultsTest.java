package org.swarmwright;

import static org.junit.jupiter.api.Assertions.assertEquals;

import java.util.List;
import java.util.Map;
import org.junit.jupiter.api.AfterEach;
import org.junit.jupiter.api.Test;

class DefaultsTest {
  @AfterEach
  void clear() {
    System.clearProperty(Defaults.BROKER_PROPERTY);
  }

  @Test
  void theEnvironmentNamesBrokerAndPrefix() {
    Map<String, String> lab = Map.of(Defaults.BROKER, "mqtt://lab", Defaults.PREFIX, "lab/1");
    assertEquals("mqtt://lab", Defaults.broker(lab));
    assertEquals("lab/1", Defaults.prefix(lab));
  }

  @Test
  void anEmptyVariableCountsAsUnset() {
    for (Map<String, String> none :
        List.of(Map.<String, String>of(), Map.of(Defaults.BROKER, "", Defaults.PREFIX, ""))) {
      assertEquals("mqtt://localhost:1883", Defaults.broker(none));
      assertEquals("", Defaults.prefix(none));
    }
  }

  @Test
  void argumentsWin() {
    System.setProperty(Defaults.BROKER_PROPERTY, "mqtt://property");
    assertEquals("mqtt://property", new CommandLine(List.of()).broker);
    CommandLine line = new CommandLine(List.of("--broker", "mqtt://given", "--prefix="));
    assertEquals("mqtt://given", line.broker);
    assertEquals("", line.prefix);
  }
}
