package org.swarmwright;

import java.util.Objects;

/** What a simulation says of itself before it is configured. */
public final class Description {
  private final String title;
  private final int dimensions;
  private final int maxAgents;
  private final int sensors;
  private final int actuators;

  private Description(String title, int dimensions, int maxAgents, int sensors, int actuators) {
    this.title = Objects.requireNonNull(title, "title");
    if (dimensions < 1 || maxAgents < 0 || sensors < 1 || actuators < 1) {
      throw new IllegalArgumentException(
          "a simulation has at least one dimension, sensor and actuator; found dimensions " + dimensions + ", sensors " + sensors
              + ", actuators " + actuators + ", maxAgents " + maxAgents);
    }
    this.dimensions = dimensions;
    this.maxAgents = maxAgents;
    this.sensors = sensors;
    this.actuators = actuators;
  }

  /**
   * Describes a simulation.
   *
   * @param title what experiment files name it
   * @param dimensions number of spatial dimensions, at least 1
   * @param sensors numbers that an agent senses in a step, at least 1
   * @param actuators numbers that an agent does in a step, at least 1
   * @throws IllegalArgumentException if a number is less
   */
  public static Description of(String title, int dimensions, int sensors, int actuators) {
    return new Description(title, dimensions, 0, sensors, actuators);
  }

  /** The same with a largest number of agents; 0 for no limit, the default. */
  public Description withMaxAgents(int number) {
    return new Description(title, dimensions, number, sensors, actuators);
  }

  /** What experiment files name it. */
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

  /** Numbers that an agent senses in a step. */
  public int sensors() {
    return sensors;
  }

  /** Numbers that an agent does in a step. */
  public int actuators() {
    return actuators;
  }
}
