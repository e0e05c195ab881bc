package org.swarmwright.server;

import java.net.InetAddress;
import java.net.UnknownHostException;
import java.security.SecureRandom;
import java.util.List;
import java.util.Locale;
import org.swarmwright.Description;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Swarmwright;

/** Who a server is, and what tells it from another one with the same ID. */
final class Identity {
  final long id;
  final String instance = String.format("%016x", new SecureRandom().nextLong());
  final String host;
  final int pid = (int) ProcessHandle.current().pid();

  Identity(long id) {
    if (id < 0) {
      throw new IllegalArgumentException(
          "the ID " + id + " is negative; use a number from 0 to " + Long.MAX_VALUE);
    }
    this.id = id;
    String name;
    try {
      name = InetAddress.getLocalHost().getHostName();
    } catch (UnknownHostException error) {
      name = "unknown";
    }
    host = name;
  }

  /** What this server says of its ability to run a simulation. */
  Capabilities capabilities(Description simulation, int batch) {
    return new Capabilities()
        .withDimensions((double) simulation.dimensions())
        .withMaxAgents(simulation.maxAgents() == 0 ? null : (double) simulation.maxAgents())
        .withSwarmwright(
            new Swarmwright()
                .withVersion(1)
                .withModes(List.of("stepwise", "batched", "offloaded"))
                .withControllers(List.of("layered", "fully_meshed", "mealy_fsm", "parameter_set"))
                .withBatch(batch)
                .withMetrics(simulation.metrics().isEmpty() ? null : simulation.metrics())
                .withDeterminism(name(simulation.determinism()))
                .withTolerance(simulation.tolerance())
                .withSensors(simulation.sensors())
                .withActuators(simulation.actuators())
                .withInstance(instance)
                .withHost(host)
                .withPid(pid));
  }

  private static Swarmwright.Determinism name(Description.Determinism determinism) {
    return determinism == null
        ? null
        : Swarmwright.Determinism.fromValue(determinism.name().toLowerCase(Locale.ROOT));
  }
}
