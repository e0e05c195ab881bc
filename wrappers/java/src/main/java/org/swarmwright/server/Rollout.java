package org.swarmwright.server;

import java.util.ArrayList;
import java.util.List;
import org.swarmwright.ParameterReader;
import org.swarmwright.Simulation;
import org.swarmwright.controllers.Architecture;
import org.swarmwright.controllers.Controller;
import org.swarmwright.extension.Refusal;

/** Episodes in this process: a simulation and a controller for each of its agents. */
final class Rollout {
  private final Simulation simulation;
  private final Architecture architecture;
  private final float[] genomes;
  private final Unread unread;
  private final float[] sensors;
  private final float[] row;

  /** The controllers of one candidate, by agent. */
  private final List<Controller> controllers = new ArrayList<>();

  private int candidate = -1;
  private float[] actuators = {};

  /**
   * Prepares episodes of several candidates.
   *
   * @param genomes weights of all candidates
   */
  Rollout(Simulation simulation, Architecture architecture, float[] genomes, Unread unread) {
    this.simulation = simulation;
    this.architecture = architecture;
    this.genomes = genomes;
    this.unread = unread;
    sensors = new float[architecture.sensors()];
    row = new float[architecture.actuators()];
  }

  /**
   * One episode, to its end.
   *
   * @param first index of the candidate's first weight
   * @throws org.swarmwright.ParameterException if the simulation refuses a parameter
   * @throws Refusal if it asks for actuators of a parameter set
   * @throws Guard.EpisodeFailed if it throws anything else
   */
  void run(ParameterReader parameters, int first) throws Guard.EpisodeFailed {
    if (candidate != first) {
      controllers.clear();
      candidate = first;
    }
    controllers.forEach(Controller::reset);
    Guard.reset(simulation, parameters, unread);
    while (!Guard.call(simulation::done)) {
      int[] acting = Guard.call(simulation::acting);
      if (acting.length > 0 && !architecture.steers()) {
        throw new Refusal(
            Refusal.Kind.INVALID,
            "simulation "
                + simulation.description().title()
                + ", agent "
                + acting[0]
                + ": the agent needs a controller, but a parameter set steers no agents; use a"
                + " controller of another kind, such as layered");
      }
      Guard.call(() -> step(acting));
    }
  }

  private float[] step(int[] acting) throws Guard.EpisodeFailed {
    while (acting.length > 0 && controllers.size() <= acting[acting.length - 1]) {
      controllers.add(new Controller(architecture, genomes, candidate));
    }
    if (actuators.length != acting.length * row.length) {
      actuators = new float[acting.length * row.length];
    }
    for (int i = 0; i < acting.length; i++) {
      Run.read(simulation, acting[i], sensors);
      controllers.get(acting[i]).step(sensors, row);
      System.arraycopy(row, 0, actuators, i * row.length, row.length);
    }
    simulation.step(actuators);
    return actuators;
  }
}
