package org.swarmwright.server;

import com.google.gson.JsonObject;
import java.math.BigInteger;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.HashMap;
import java.util.List;
import java.util.Map;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.Simulation;
import org.swarmwright.controllers.Architecture;
import org.swarmwright.controllers.Controller;
import org.swarmwright.extension.Evaluate;
import org.swarmwright.extension.Failure;
import org.swarmwright.extension.Refusal;

/** One request for offloaded evaluation: every candidate in every episode, computed in whatever thread runs it. */
final class Job implements Runnable {
  final Evaluate request;

  /** When the tool gives the work to somebody else, nanoseconds of {@link System#nanoTime}; null for never. */
  final Long expires;

  private final Simulation simulation;
  private final Architecture architecture;
  private final int candidates;
  private final int weights;
  private volatile boolean aborted;

  // The result.
  final double[] fitness;
  final Map<String, double[]> metrics = new HashMap<>();
  final List<Failure> failed = new ArrayList<>();
  Refusal error;
  double seconds;

  Job(Evaluate request, Simulation simulation, Architecture architecture, Long expires) {
    this.request = request;
    this.simulation = simulation;
    this.architecture = architecture;
    this.expires = expires;
    weights = (int) architecture.weightCount();
    candidates = request.genomes.length / weights;
    fitness = new double[candidates * request.seeds.length];
  }

  /** Bytes held. */
  long size() {
    return 4L * request.genomes.length + 8L * request.seeds.length;
  }

  /** Nobody waits for the result. */
  void abort() {
    aborted = true;
  }

  @Override
  public void run() {
    long start = System.nanoTime();
    try {
      evaluate();
    } catch (ParameterException refused) {
      error = new Refusal(Refusal.Kind.INVALID, refused.getMessage());
    }
    seconds = (System.nanoTime() - start) / 1e9;
  }

  private void evaluate() {
    int episodes = request.seeds.length;
    ParameterReader[] parameters = new ParameterReader[episodes];
    for (int episode = 0; episode < episodes; episode++) {
      parameters[episode] = new ParameterReader(seeded(request.parameters, request.seeds[episode]));
    }
    Rollout rollout = new Rollout(simulation, architecture, request.genomes);
    for (int candidate = 0; candidate < candidates; candidate++) {
      for (int episode = 0; episode < episodes; episode++) {
        if (aborted) {
          return;
        }
        int index = candidate * episodes + episode;
        try {
          fitness[index] = rollout.run(parameters[episode], candidate * weights);
          note(index);
        } catch (Guard.Broken broken) {
          fitness[index] = Double.NaN;
          failed.add(new Failure(candidate, episode, broken.getMessage()));
        }
      }
    }
  }

  private void note(int index) throws Guard.Broken {
    for (Map.Entry<String, Double> metric : Guard.call(simulation::metrics).entrySet()) {
      double[] values =
          metrics.computeIfAbsent(
              metric.getKey(),
              name -> {
                double[] unknown = new double[fitness.length];
                Arrays.fill(unknown, Double.NaN);
                return unknown;
              });
      values[index] = metric.getValue();
    }
  }

  /** Parameters with a seed, 64 bits without sign. */
  static JsonObject seeded(JsonObject parameters, long seed) {
    JsonObject copy = new JsonObject();
    parameters.entrySet().forEach(entry -> copy.add(entry.getKey(), entry.getValue()));
    copy.addProperty("seed", new BigInteger(Long.toUnsignedString(seed)));
    return copy;
  }

  /** Episodes in this process: a simulation and a controller for each of its agents. */
  private static final class Rollout {
    private final Simulation simulation;
    private final Architecture architecture;
    private final float[] genomes;
    private final float[] sensors;
    private final float[] row;
    private final List<Controller> controllers = new ArrayList<>();
    private int genome = -1;
    private float[] actuators = {};

    Rollout(Simulation simulation, Architecture architecture, float[] genomes) {
      this.simulation = simulation;
      this.architecture = architecture;
      this.genomes = genomes;
      sensors = new float[architecture.sensors()];
      row = new float[architecture.actuators()];
    }

    /** The fitness of one episode; {@code first} is the index of the candidate's first weight. */
    double run(ParameterReader parameters, int first) throws Guard.Broken {
      if (genome != first) {
        controllers.clear();
        genome = first;
      }
      controllers.forEach(Controller::reset);
      Guard.reset(simulation, parameters);
      return Guard.finite(Guard.call(() -> toTheEnd(first)));
    }

    private double toTheEnd(int first) throws Guard.Broken {
      for (int[] acting = simulation.acting(); acting.length > 0; acting = simulation.acting()) {
        step(acting, first);
      }
      return simulation.fitness();
    }

    private void step(int[] acting, int first) throws Guard.Broken {
      while (controllers.size() <= acting[acting.length - 1]) {
        controllers.add(new Controller(architecture, genomes, first));
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
    }
  }
}
