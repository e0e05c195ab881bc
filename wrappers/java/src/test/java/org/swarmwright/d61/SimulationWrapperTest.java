package org.swarmwright.d61;

import static org.junit.jupiter.api.Assertions.assertEquals;
import static org.junit.jupiter.api.Assertions.assertFalse;
import static org.junit.jupiter.api.Assertions.assertNull;
import static org.junit.jupiter.api.Assertions.assertThrows;
import static org.junit.jupiter.api.Assertions.assertTrue;

import java.io.IOException;
import java.util.List;
import org.eclipse.paho.client.mqttv3.MqttCallback;
import org.eclipse.paho.client.mqttv3.MqttMessage;
import org.junit.jupiter.api.AfterEach;
import org.junit.jupiter.api.BeforeEach;
import org.junit.jupiter.api.Test;
import org.swarmwright.BrokerException;
import org.swarmwright.Vectors;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.MessageException;
import org.swarmwright.messages.Server;

/** The class of D6.1, with a broker that only takes what it is sent. */
class SimulationWrapperTest {
  private Sink broker;

  @BeforeEach
  void listen() throws IOException {
    broker = new Sink();
    System.setProperty("swarmwright.broker", "mqtt://127.0.0.1:" + broker.port());
  }

  @AfterEach
  void hangUp() throws IOException {
    System.clearProperty("swarmwright.broker");
    broker.close();
  }

  private static Server info() {
    return new Server()
        .withServer(1L)
        .withSimulations(List.of("minisim"))
        .withCapabilities(new Capabilities().withDimensions(2.0));
  }

  private static MqttMessage message(String name) {
    return new MqttMessage(Vectors.bytes("messages/" + name + ".d61.json"));
  }

  @Test
  void whatD61PrintsIsHandled() throws Exception {
    try (FromTheText server = new FromTheText(info())) {
      MqttCallback callback = server;
      callback.messageArrived("discovery", message("discovery"));
      String answer = broker.await("\"simulations\"");
      assertTrue(answer.contains("\"server\":1,"), answer);
      assertTrue(
          answer.contains(
              "\"simulation_hash\":\"21a57f2fe765e1ae4a8bf15d73fc1bf2a533f547f2343d12a499d9c0592044d4\""),
          answer);
      assertTrue(answer.contains("\"capabilities\":{\"dimensions\":2}"), answer);
      callback.messageArrived("parameters", message("parameters"));
      callback.messageArrived("control", message("control"));
      callback.messageArrived("actuator", message("actuator"));
      assertEquals(3, server.handled);
      assertFalse(server.isAvailable());
      assertNull(
          server.getServerInfo().getSimulationHash(), "the information given is left as it was");
    }
  }

  @Test
  void whatIsForOtherServersIsNot() throws Exception {
    try (FromTheText server = new FromTheText(info().withServer(2L))) {
      server.messageArrived("parameters", message("parameters"));
      server.messageArrived("control", message("control"));
      server.messageArrived("actuator", message("actuator"));
      server.messageArrived("another", message("actuator"));
      assertEquals(0, server.handled);
      assertThrows(
          MessageException.class,
          () -> server.messageArrived("control", new MqttMessage("{}".getBytes())));
    }
  }

  @Test
  void withoutABrokerItSaysWhere() throws IOException {
    broker.close();
    BrokerException error =
        assertThrows(BrokerException.class, () -> new FromTheText(info()).close());
    assertTrue(error.getMessage().contains("127.0.0.1:" + broker.port()), error.getMessage());
  }
}
