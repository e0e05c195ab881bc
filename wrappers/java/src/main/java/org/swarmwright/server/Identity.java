package org.swarmwright.server;

import java.net.InetAddress;
import java.net.UnknownHostException;
import java.security.SecureRandom;
import java.util.List;
import java.util.Locale;
import org.swarmwright.Description;
import org.swarmwright.controllers.Architecture;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Swarmwright;

/** What identifies a server, also among others with the same ID. */
final class Identity {
  final long id;
  final String instance = String.format("%016x", new SecureRandom().nextLong());
  final String host;
  final int pid = (int) ProcessHandle.current().pid();

  /** Name of this machine. */
  private static String hostName() {
    try {
      return InetAddress.getLocalHost().getHostName();
    } catch (UnknownHostException error) {
      return "unknown";
    }
  }

  Identity(long id) {
    if (id < 0) {
      throw new IllegalArgumentException(
          "the ID " + id + " is negative; use a number from 0 to " + Long.MAX_VALUE);
    }
    this.id = id;
    host = hostName();
  }

  /** Host and process of another server, in words. */
  static String words(Swarmwright other) {
    String host = other == null || other.getHost() == null ? "an unknown host" : other.getHost();
    return other == null || other.getPid() == null ? host : host + ", process " + other.getPid();
  }

  /**
   * Whether another server's process is known to have ended, which can be checked on this machine
   * only. A broker that was killed keeps the presence of servers that were killed with it.
   */
  boolean isDead(Swarmwright other) {
    return other != null
        && host.equals(other.getHost())
        && other.getPid() != null
        && ProcessHandle.of(other.getPid()).isEmpty();
  }

  /** Whether a message is for this server: its {@code instance} field, null if it has none. */
  boolean isMeant(String addressee) {
    return addressee == null || addressee.equals(instance);
  }

  /** The capabilities of this server for the simulation that it offers. */
  Capabilities capabilities(Offer offer) {
    Description simulation = offer.description();
    return new Capabilities()
        .withDimensions((double) simulation.dimensions())
        .withMaxAgents(simulation.maxAgents() == 0 ? null : (double) simulation.maxAgents())
        .withSwarmwright(
            new Swarmwright()
                .withVersion(1)
                .withModes(List.of("stepwise", "batched", "offloaded"))
                .withControllers(Architecture.kinds())
                .withBatch(offer.maxBatch())
                .withMetrics(simulation.metrics().isEmpty() ? null : simulation.metrics())
                .withDeterminism(name(simulation.determinism()))
                .withTolerance(simulation.tolerance())
                .withSensors(simulation.sensors())
                .withActuators(simulation.actuators())
                .withScenes(offer.hasScenes() ? true : null)
                .withControl(true)
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
