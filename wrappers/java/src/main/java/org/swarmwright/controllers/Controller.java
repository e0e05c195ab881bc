package org.swarmwright.controllers;

import java.util.Arrays;

/** The controller of one agent: an architecture, weights, and what it keeps between steps. */
public final class Controller {
  private final Architecture architecture;
  private final float[] weights;
  private final int first;
  private final float[] state;
  private final float[] scratch;

  /**
   * At the start of an episode.
   *
   * @param weights those of many controllers; not copied
   * @param first index of the first one of this controller
   * @throws IllegalArgumentException if there are too few
   */
  public Controller(Architecture architecture, float[] weights, int first) {
    if (first < 0 || weights.length - first < architecture.weightCount()) {
      throw new IllegalArgumentException(
          (weights.length - first) + " weights found, expected " + architecture.weightCount());
    }
    this.architecture = architecture;
    this.weights = weights;
    this.first = first;
    state = new float[architecture.stateLength()];
    scratch = new float[architecture.scratchLength()];
  }

  /** Goes to the start of an episode. */
  public void reset() {
    Arrays.fill(state, 0f);
  }

  /**
   * One step.
   *
   * @param sensors as many as the architecture has, finite
   * @param actuators is filled, in -1..1
   * @throws IllegalArgumentException if there are more or fewer of either, or a sensor is not
   *     finite
   */
  public void step(float[] sensors, float[] actuators) {
    if (sensors.length != architecture.sensors() || actuators.length != architecture.actuators()) {
      throw new IllegalArgumentException(
          sensors.length
              + " sensors and "
              + actuators.length
              + " actuators found, expected "
              + architecture.sensors()
              + " and "
              + architecture.actuators());
    }
    for (int i = 0; i < sensors.length; i++) {
      if (!Float.isFinite(sensors[i])) {
        throw new IllegalArgumentException(
            "sensor " + i + " is " + sensors[i] + ", not a finite number");
      }
    }
    architecture.step(weights, first, state, scratch, sensors, actuators);
  }
}
