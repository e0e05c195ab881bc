package org.swarmwright;

import java.util.List;
import java.util.Objects;

/** The properties of a simulation, which do not depend on parameters. */
public final class Description {
  private final String title;
  private final int dimensions;
  private final int maxAgents;
  private final int sensors;
  private final int actuators;
  private final List<String> metrics;
  private final Determinism determinism;
  private final Double tolerance;

  /** How far two evaluations of one episode with one controller agree, on any server. */
  public enum Determinism {
    /** To the bit. */
    BITWISE,
    /** Within a tolerance. */
    STATISTICAL,
    /** Not at all. */
    NONE
  }

  private Description(
      String title,
      int dimensions,
      int maxAgents,
      int sensors,
      int actuators,
      List<String> metrics,
      Determinism determinism,
      Double tolerance) {
    this.title = Objects.requireNonNull(title, "title");
    if (dimensions < 1 || maxAgents < 0 || sensors < 1 || actuators < 1) {
      throw new IllegalArgumentException(
          "a simulation has at least one dimension, sensor and actuator; found dimensions "
              + dimensions
              + ", sensors "
              + sensors
              + ", actuators "
              + actuators
              + ", maxAgents "
              + maxAgents);
    }
    for (String name : metrics) {
      if (!name.matches("[A-Za-z_][A-Za-z0-9_]*")) {
        throw new IllegalArgumentException(
            "metric \"" + name + "\": a name must be a letter or _, then letters, digits and _");
      }
    }
    this.metrics = List.copyOf(metrics);
    this.determinism = determinism;
    this.tolerance = tolerance;
    this.dimensions = dimensions;
    this.maxAgents = maxAgents;
    this.sensors = sensors;
    this.actuators = actuators;
  }

  /**
   * Describes a simulation.
   *
   * @param title its name in experiment files
   * @param dimensions number of spatial dimensions, at least 1
   * @param sensors sensor values of an agent in a step, at least 1
   * @param actuators actuator values of an agent in a step, at least 1
   * @throws IllegalArgumentException if a number is smaller
   */
  public static Description of(String title, int dimensions, int sensors, int actuators) {
    return new Description(title, dimensions, 0, sensors, actuators, List.of(), null, null);
  }

  /** A copy with a largest number of agents; 0 for no limit, the default. */
  public Description withMaxAgents(int number) {
    return new Description(
        title, dimensions, number, sensors, actuators, metrics, determinism, tolerance);
  }

  /**
   * A copy with the names of the values of {@link Simulation#metrics}, none by default.
   *
   * @throws IllegalArgumentException if a name is not a letter or _, then letters, digits and _
   */
  public Description withMetrics(String... names) {
    return new Description(
        title, dimensions, maxAgents, sensors, actuators, List.of(names), determinism, tolerance);
  }

  /** A copy that declares whether an episode can be repeated to the bit, or not at all. */
  public Description with(Determinism declared) {
    if (declared == Determinism.STATISTICAL) {
      throw new IllegalArgumentException("statistical: give a tolerance, with withTolerance");
    }
    return new Description(
        title, dimensions, maxAgents, sensors, actuators, metrics, declared, null);
  }

  /**
   * A copy that declares that repeated episodes agree within a tolerance.
   *
   * @param largest how far fitness and metrics may differ, relative to the larger one, absolute
   *     below 1
   * @throws IllegalArgumentException if it is negative, NaN or infinite
   */
  public Description withTolerance(double largest) {
    if (!(largest >= 0) || Double.isInfinite(largest)) {
      throw new IllegalArgumentException("tolerance: expected a number, 0 or more, not " + largest);
    }
    return new Description(
        title,
        dimensions,
        maxAgents,
        sensors,
        actuators,
        metrics,
        Determinism.STATISTICAL,
        largest);
  }

  /** Its name in experiment files. */
  public String title() {
    return title;
  }

  /** Number of spatial dimensions. */
  public int dimensions() {
    return dimensions;
  }

  /** Largest number of agents; 0 for no limit. */
  public int maxAgents() {
    return maxAgents;
  }

  /** Sensor values of an agent in a step. */
  public int sensors() {
    return sensors;
  }

  /** Actuator values of an agent in a step. */
  public int actuators() {
    return actuators;
  }

  /** Whether an episode can be repeated; null if that is not known. */
  public Determinism determinism() {
    return determinism;
  }

  /** How far repeated episodes may differ, if that is declared; else null. */
  public Double tolerance() {
    return tolerance;
  }

  /** Names of the metrics of an episode. */
  public List<String> metrics() {
    return metrics;
  }
}
