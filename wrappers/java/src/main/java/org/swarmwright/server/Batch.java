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

  /** Whether somebody was told of the waiting. */
  boolean told;

  /** Whether an episode goes on by itself, so that nobody's actuators are waited for. */
  boolean goesOn;

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
  Batch(BatchStart start, long server, Description description, List<Simulation> simulations) {
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
        Guard.reset(simulation, parameters);
      } catch (ParameterException error) {
        throw new Refusal(Refusal.Kind.INVALID, error.getMessage());
      } catch (Guard.Broken broken) {
        fail(episode, broken, failed);
      }
    }
  }

  private void fail(int episode, Guard.Broken broken, List<Failure> list) {
    rows[episode] = ENDED;
    Replies.addFailure(list, 0, episode, broken);
  }

  /**
   * Makes a step of every episode whose simulation steers its agents itself; whether there is one.
   */
  boolean goOn(long now) {
    waitingSince = now;
    goesOn = false;
    for (int episode = 0; episode < rows.length; episode++) {
      Simulation simulation = simulations.get(episode);
      try {
        if (rows[episode] != ENDED
            && Guard.call(() -> simulation.acting().length == 0 && !simulation.done())) {
          Guard.run(() -> simulation.step(new float[0]));
          goesOn = true;
        }
      } catch (Guard.Broken broken) {
        fail(episode, broken, failed);
      }
    }
    return goesOn;
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
    told = false;
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
      } catch (Guard.Broken broken) {
        message.agents.truncate(agents);
        message.sensors.truncate(sensors);
        fail(episode, broken, message.failed);
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

  private void sense(int episode, BatchSensors message) throws Guard.Broken {
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
   * @throws MessageException if they are not those waited for; the batch goes on waiting
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
      float[] own = new float[rows[episode] * width];
      for (int i = 0; i < own.length; i++) {
        own[i] = Run.clamp(message.actuators[next++]);
      }
      Simulation simulation = simulations.get(episode);
      try {
        Guard.run(() -> simulation.step(own));
      } catch (Guard.Broken broken) {
        fail(episode, broken, failed);
      }
    }
    step++;
  }

  /** The message that says why the batch is not served any more. */
  BatchSensors refused(Refusal refusal) {
    return new BatchSensors(start.request, server, step, refusal);
  }

  /** Who is missing and for how long, in words. */
  String waitingFor(long now) {
    return String.format(
        Locale.ROOT,
        "%s has not sent the actuators of step %d of its batch for %.1f s",
        start.tool,
        step,
        (now - waitingSince) / 1e9);
  }
}
