package org.swarmwright.server;

import com.google.gson.JsonObject;
import com.google.gson.JsonPrimitive;
import java.nio.charset.StandardCharsets;
import java.util.Arrays;
import java.util.List;
import java.util.Locale;
import java.util.Map;
import java.util.TreeMap;
import java.util.function.Consumer;
import java.util.stream.Collectors;
import java.util.stream.IntStream;
import org.swarmwright.ParameterReader;
import org.swarmwright.Scene;
import org.swarmwright.Simulation;
import org.swarmwright.extension.SceneWriter;
import org.swarmwright.messages.Actuator;
import org.swarmwright.messages.Control;
import org.swarmwright.messages.Decimals;
import org.swarmwright.messages.Fitness;
import org.swarmwright.messages.MessageException;

/** An episode that is stepped by single messages: which agents act, which actuators have come. */
final class Run {
  /** The size limit of a sensor message. */
  private static final int MAX_SENSOR_BYTES = 64 << 20;

  final String hash;
  final String tool;

  /** Topic, without prefix, for the message that the episode failed; null for none. */
  final String reply;

  final boolean visual;

  /** What the tool wants of scenes in addition to bodies; null if it wants none. */
  private final List<String> scenes;

  private long steps;

  /** When the step under way began to wait for actuators. */
  long waitingSince;

  /** Whether the operator was warned that the step waits. */
  boolean warned;

  /**
   * When the run goes on, if it does not wait for actuators: it is being shown, or the simulation
   * steers itself; else 0.
   */
  long resumeAt;

  private final Simulation simulation;
  private final String head;
  private final float[] sensors;
  private final int perAgent;
  private int[] acting = {};
  private boolean[] arrived = {};
  private int missing;
  private float[] actuators = {};

  /** Resets the simulation. */
  Run(Simulation simulation, JsonObject parameters, Control control, Unread unread)
      throws Guard.EpisodeFailed {
    this.simulation = simulation;
    hash = control.getSimulationHash();
    tool = control.getTool();
    reply = control.getReply();
    visual = control.getVisual();
    scenes = reply == null ? null : control.getScenes();
    Guard.reset(simulation, new ParameterReader(parameters), unread);
    String title = new JsonPrimitive(simulation.description().title()).toString();
    String text = new JsonPrimitive(hash).toString();
    head = "{\"simulation\":" + title + ",\"simulation_hash\":" + text + ",\"agent\":";
    sensors = new float[simulation.description().sensors()];
    perAgent = simulation.description().actuators();
  }

  /** What follows a step. */
  enum Next {
    /** Actuators are waited for. */
    ACTUATORS,
    /** The simulation, which steers its agents itself, has made a step and can make another. */
    STEP,
    /** It has ended. */
    FITNESS
  }

  /**
   * Sends the sensors of all acting agents, or has a simulation that steers its agents itself make
   * a step.
   */
  Next sense(long now, Consumer<byte[]> send) throws Guard.EpisodeFailed {
    waitingSince = now;
    warned = false;
    acting = Guard.call(() -> simulation.acting().clone());
    if (acting.length == 0) {
      if (Guard.call(simulation::done)) {
        return Next.FITNESS;
      }
      Guard.run(() -> simulation.step(actuators));
      steps++;
      return Next.STEP;
    }
    missing = acting.length;
    arrived = new boolean[missing];
    actuators = new float[missing * perAgent];
    for (int agent : acting) {
      Guard.call(() -> read(simulation, agent, sensors));
      StringBuilder text = new StringBuilder(head).append(agent).append(",\"sensor\":[");
      for (int i = 0; i < sensors.length; i++) {
        text.append(i == 0 ? "" : ",").append(Decimals.shortest(sensors[i]));
      }
      byte[] message = text.append("]}").toString().getBytes(StandardCharsets.UTF_8);
      if (message.length > MAX_SENSOR_BYTES) {
        throw new Guard.EpisodeFailed(
            "the sensor message of agent "
                + agent
                + " has "
                + message.length
                + " bytes, more than the "
                + MAX_SENSOR_BYTES
                + " allowed",
            true);
      }
      send.accept(message);
    }
    return Next.ACTUATORS;
  }

  /**
   * Reads the sensors of an agent.
   *
   * @throws Guard.EpisodeFailed if one is NaN or infinite
   */
  static float[] read(Simulation simulation, int agent, float[] sensors)
      throws Guard.EpisodeFailed {
    simulation.sense(agent, sensors);
    for (int i = 0; i < sensors.length; i++) {
      if (!Float.isFinite(sensors[i])) {
        throw new Guard.EpisodeFailed(
            "sensor " + i + " of agent " + agent + " is " + sensors[i] + ", not a finite number");
      }
    }
    return sensors;
  }

  /**
   * The scene of this moment as a message; null if the tool wants none, or there is none. What
   * cannot be measured yet is left out.
   */
  byte[] scene(long server) throws Guard.EpisodeFailed {
    Scene scene = scenes == null ? null : Guard.call(simulation::scene);
    if (scene == null) {
      return null;
    }
    Double fitness = null;
    Map<String, Double> metrics = Map.of();
    try {
      fitness = Guard.finite(Guard.call(simulation::fitness));
      metrics = metrics();
    } catch (Guard.EpisodeFailed unknown) {
      // It is known at the end only.
      metrics = Map.of();
    }
    double seconds = pictureNanos() / 1e9;
    SceneWriter.Head head = new SceneWriter.Head(server, hash, steps, fitness, metrics, seconds);
    return Guard.call(() -> SceneWriter.write(scene, head, scenes));
  }

  private Map<String, Double> metrics() throws Guard.EpisodeFailed {
    List<String> names = simulation.description().metrics();
    double[] values = Guard.metrics(simulation);
    Map<String, Double> metrics = new TreeMap<>();
    for (int i = 0; i < values.length; i++) {
      if (Double.isFinite(values[i])) {
        metrics.put(names.get(i), values[i]);
      }
    }
    return metrics;
  }

  /** The message that ends the episode, with all metrics that are finite. */
  Fitness fitness() throws Guard.EpisodeFailed {
    Map<String, Double> metrics = metrics();
    return new Fitness()
        .withSimulation(simulation.description().title())
        .withSimulationHash(hash)
        .withFitness(Guard.finite(Guard.call(simulation::fitness)))
        .withMetrics(metrics.isEmpty() ? null : metrics);
  }

  /**
   * Sets the actuators of one agent, and makes the step when those of all agents have come.
   *
   * @return whether the step was made
   * @throws MessageException if the run does not wait for them; it keeps waiting for the right ones
   */
  boolean actuate(Actuator message) throws Guard.EpisodeFailed {
    long agent = message.getAgent();
    int slot = agent > Integer.MAX_VALUE ? -1 : Arrays.binarySearch(acting, (int) agent);
    if (slot < 0) {
      throw new MessageException("agent " + agent + " is not among those asked for actuators");
    }
    List<Double> values = message.getActuator();
    if (values.size() != perAgent) {
      throw new MessageException(
          values.size() + " actuators for agent " + agent + ", expected " + perAgent);
    }
    if (resumeAt != 0 || arrived[slot]) {
      throw new MessageException("the actuators of agent " + agent + " arrived twice");
    }
    arrived[slot] = true;
    for (int i = 0; i < perAgent; i++) {
      actuators[slot * perAgent + i] = clamp(values.get(i).floatValue());
    }
    if (--missing > 0) {
      return false;
    }
    Guard.run(() -> simulation.step(actuators));
    steps++;
    return true;
  }

  static float clamp(float value) {
    return value > 1f ? 1f : value < -1f ? -1f : value;
  }

  /** Whose actuators are missing and for how long, in words. */
  String waitingFor(long now) {
    String agents =
        IntStream.range(0, acting.length)
            .filter(slot -> !arrived[slot])
            .mapToObj(slot -> "" + acting[slot])
            .limit(8)
            .collect(Collectors.joining(", "));
    String holder = tool == null ? "the optimization tool" : tool;
    return String.format(
        Locale.ROOT,
        "%s has not sent actuators for %d of %d agents (%s%s) for %.1f s",
        holder,
        missing,
        acting.length,
        agents,
        missing > 8 ? ", ..." : "",
        (now - waitingSince) / 1e9);
  }

  /** The picture to show now; null if there is none to show. */
  String picture() throws Guard.EpisodeFailed {
    return visual ? Guard.call(simulation::picture) : null;
  }

  long pictureNanos() throws Guard.EpisodeFailed {
    return 1_000_000L * Math.max(0, Guard.call(simulation::pictureMillis));
  }
}
