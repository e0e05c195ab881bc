package org.swarmwright.server;

import com.google.gson.JsonObject;
import java.math.BigInteger;
import java.util.ArrayList;
import java.util.Arrays;
import java.util.List;
import java.util.Map;
import java.util.TreeMap;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.Simulation;
import org.swarmwright.controllers.Architecture;
import org.swarmwright.controllers.ParameterSet;
import org.swarmwright.extension.Evaluate;
import org.swarmwright.extension.Failure;
import org.swarmwright.extension.Refusal;

/**
 * One request for offloaded evaluation: every candidate in every episode, computed in the thread
 * that runs it.
 */
final class Job implements Runnable {
  final Evaluate request;

  /**
   * When the tool gives the request to another server, nanoseconds of {@link System#nanoTime}; null
   * for never.
   */
  final Long expires;

  private final Simulation simulation;
  private final Architecture architecture;
  private final Unread unread;
  private final int candidates;
  private final int weights;
  private volatile boolean aborted;

  // The result.
  final double[] fitness;
  final Map<String, double[]> metrics = new TreeMap<>();
  final List<Failure> failed = new ArrayList<>();
  Refusal error;
  double seconds;

  Job(
      Evaluate request,
      Simulation simulation,
      Architecture architecture,
      Unread unread,
      Long expires) {
    this.request = request;
    this.simulation = simulation;
    this.architecture = architecture;
    this.unread = unread;
    this.expires = expires;
    weights = (int) architecture.weightCount();
    candidates = request.genomes.length / weights;
    fitness = nan();
    request.metrics.forEach(name -> metrics.put(name, nan()));
  }

  /** The results of episodes that have not been computed or have failed. */
  private double[] nan() {
    double[] numbers = new double[candidates * request.seeds.length];
    Arrays.fill(numbers, Double.NaN);
    return numbers;
  }

  /** Bytes of the request in memory. */
  long size() {
    return 4L * request.genomes.length + 8L * request.seeds.length;
  }

  /** The result is not needed any more: stops after the episode under way. */
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
    } catch (Refusal refused) {
      error = refused;
    } catch (Throwable fault) {
      // Without a reply the tool would wait until its lease expires.
      error = new Refusal(Refusal.Kind.FAILED, "the server failed: " + fault);
    }
    seconds = (System.nanoTime() - start) / 1e9;
  }

  private void evaluate() {
    int episodes = request.seeds.length;
    JsonObject[] parameters = new JsonObject[episodes];
    for (int episode = 0; episode < episodes; episode++) {
      parameters[episode] = seeded(request.parameters, request.seeds[episode]);
    }
    Rollout rollout = new Rollout(simulation, architecture, request.genomes, unread);
    for (int candidate = 0; candidate < candidates; candidate++) {
      int first = candidate * weights;
      for (int episode = 0; episode < episodes && !aborted; episode++) {
        try {
          rollout.run(new ParameterReader(merged(parameters[episode], first)), first);
          setResults(candidate * episodes + episode, Guard.results(simulation, request.metrics));
        } catch (Guard.EpisodeFailed failure) {
          Replies.addFailure(failed, candidate, episode, failure);
        }
      }
    }
  }

  private void setResults(int index, double[] results) {
    fitness[index] = results[0];
    for (int i = 0; i < request.metrics.size(); i++) {
      metrics.get(request.metrics.get(i))[index] = results[1 + i];
    }
  }

  private JsonObject merged(JsonObject parameters, int first) {
    return architecture instanceof ParameterSet
        ? ((ParameterSet) architecture).merged(parameters, request.genomes, first)
        : parameters;
  }

  /** A copy of parameters with a seed, an unsigned 64-bit integer. */
  static JsonObject seeded(JsonObject parameters, long seed) {
    JsonObject copy = new JsonObject();
    parameters.entrySet().forEach(entry -> copy.add(entry.getKey(), entry.getValue()));
    copy.addProperty("seed", new BigInteger(Long.toUnsignedString(seed)));
    return copy;
  }
}
