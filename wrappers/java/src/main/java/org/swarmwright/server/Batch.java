package org.swarmwright.server;

import java.util.ArrayList;
import java.util.Arrays;
import java.util.List;
import java.util.Locale;
import org.swarmwright.Description;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.Simulation;
import org.swarmwright.extension.BatchActuators;
import org.swarmwright.extension.BatchSensors;
import org.swarmwright.extension.BatchStart;
import org.swarmwright.extension.Block;
import org.swarmwright.extension.Failure;
import org.swarmwright.extension.MapReader;
import org.swarmwright.extension.Refusal;
import org.swarmwright.messages.MessageException;

/**
 * Episodes that are stepped together: all agents that act next, of all episodes, in one message.
 */
final class Batch {
  private static final int ENDED = -1;

  final BatchStart start;

  /** When the step under way began to wait for actuators. */
  long waitingSince;

  /** Whether the operator was warned that the step waits. */
  boolean warned;

  /** Whether an episode has made a step without actuators, and may make another. */
  private boolean selfSteering;

  private final long server;
  private final Description description;
  private final List<Simulation> simulations;

  /** By episode, how many rows are its agents. */
  private final int[] rows;

  private final List<Failure> failed = new ArrayList<>();
  private long step;
  private int allRows;

  /**
   * Resets a simulation for each seed.
   *
   * @throws Refusal if it refuses a parameter
   */
  Batch(
      BatchStart start,
      long server,
      Description description,
      List<Simulation> simulations,
      Unread unread) {
    this.start = start;
    this.server = server;
    this.description = description;
    this.simulations = simulations;
    rows = new int[simulations.size()];
    for (int episode = 0; episode < rows.length; episode++) {
      Simulation simulation = simulations.get(episode);
      ParameterReader parameters =
          new ParameterReader(Job.seeded(start.parameters, start.seeds[episode]));
      try {
        Guard.reset(simulation, parameters, unread);
      } catch (ParameterException error) {
        throw new Refusal(Refusal.Kind.INVALID, error.getMessage());
      } catch (Guard.EpisodeFailed failure) {
        fail(episode, failure, failed);
      }
    }
  }

  private void fail(int episode, Guard.EpisodeFailed failure, List<Failure> list) {
    rows[episode] = ENDED;
    Replies.addFailure(list, 0, episode, failure);
  }

  /**
   * Makes a step of every episode whose simulation steers its agents itself.
   *
   * @return whether there is one
   */
  boolean stepSelfSteering(long now) {
    waitingSince = now;
    selfSteering = false;
    for (int episode = 0; episode < rows.length; episode++) {
      Simulation simulation = simulations.get(episode);
      try {
        if (rows[episode] != ENDED
            && Guard.call(() -> simulation.acting().length == 0 && !simulation.done())) {
          Guard.run(() -> simulation.step(new float[0]));
          selfSteering = true;
        }
      } catch (Guard.EpisodeFailed failure) {
        fail(episode, failure, failed);
      }
    }
    return selfSteering;
  }

  /** Whether the last step needed no actuators, so that the next one is due at once. */
  boolean isSelfSteering() {
    return selfSteering;
  }

  /** Whether all episodes have ended, or failed. */
  boolean isOver() {
    return Arrays.stream(rows).allMatch(number -> number == ENDED);
  }

  /**
   * The message of the step that begins.
   *
   * @throws Refusal if the agents are too many for one
   */
  BatchSensors sense(long now) {
    waitingSince = now;
    warned = false;
    BatchSensors message = new BatchSensors(start.request, server, step, null);
    message.failed.addAll(failed);
    failed.clear();
    allRows = 0;
    for (int episode = 0; episode < rows.length; episode++) {
      if (rows[episode] == ENDED) {
        continue;
      }
      int agents = message.agents.size();
      int sensors = message.sensors.size();
      try {
        sense(episode, message);
      } catch (Guard.EpisodeFailed failure) {
        message.agents.truncate(agents);
        message.sensors.truncate(sensors);
        fail(episode, failure, message.failed);
      }
      if (message.sensors.size() + 2L * message.agents.size() > MapReader.MAX_BLOCK / 2) {
        throw new Refusal(
            Refusal.Kind.INVALID,
            "seeds: the agents of "
                + rows.length
                + " episodes are too many for one message; start fewer at once");
      }
    }
    return message;
  }

  private void sense(int episode, BatchSensors message) throws Guard.EpisodeFailed {
    Simulation simulation = simulations.get(episode);
    int[] acting = Guard.call(simulation::acting);
    float[] sensors = new float[description.sensors()];
    for (int agent : acting) {
      Guard.call(() -> Run.read(simulation, agent, sensors));
      message.agents.add(agent);
      for (float sensor : sensors) {
        message.sensors.add(sensor);
      }
    }
    if (acting.length == 0) {
      double[] results = Guard.results(simulation, start.metrics);
      rows[episode] = ENDED;
      message.ended.add(episode);
      message.fitness.add(results[0]);
      for (int i = 0; i < start.metrics.size(); i++) {
        message
            .metrics
            .computeIfAbsent(start.metrics.get(i), name -> new Block())
            .add(results[1 + i]);
      }
      return;
    }
    rows[episode] = acting.length;
    allRows += acting.length;
    for (int i = 0; i < acting.length; i++) {
      message.episodes.add(episode);
    }
  }

  /**
   * Takes the actuators of a step and makes it.
   *
   * @throws MessageException if the batch does not wait for them; it keeps waiting for the right
   *     ones
   */
  void actuate(BatchActuators message) {
    if (message.step != step) {
      throw new MessageException(
          "they answer step " + message.step + ", but step " + step + " waits for actuators");
    }
    int width = description.actuators();
    if (message.actuators.length != allRows * width) {
      throw new MessageException(
          message.actuators.length
              + " actuators, expected "
              + allRows * width
              + " ("
              + allRows
              + " rows of "
              + width
              + ")");
    }
    int next = 0;
    for (int episode = 0; episode < rows.length; episode++) {
      if (rows[episode] == ENDED) {
        continue;
      }
      float[] actuators = new float[rows[episode] * width];
      for (int i = 0; i < actuators.length; i++) {
        actuators[i] = Run.clamp(message.actuators[next++]);
      }
      Simulation simulation = simulations.get(episode);
      try {
        Guard.run(() -> simulation.step(actuators));
      } catch (Guard.EpisodeFailed failure) {
        fail(episode, failure, failed);
      }
    }
    step++;
  }

  /** The message that ends the batch and says why. */
  BatchSensors refused(Refusal refusal) {
    return new BatchSensors(start.request, server, step, refusal);
  }

  /** Whose actuators are missing and for how long, in words. */
  String waitingFor(long now) {
    return String.format(
        Locale.ROOT,
        "%s has not sent the actuators of step %d of its batch for %.1f s",
        start.tool,
        step,
        (now - waitingSince) / 1e9);
  }
}
