package org.swarmwright.minisim;

import com.google.gson.JsonObject;
import java.util.Arrays;
import java.util.Locale;
import org.swarmwright.Description;
import org.swarmwright.ParameterReader;
import org.swarmwright.Scene;
import org.swarmwright.Simulation;
import org.swarmwright.controllers.Functions;

/**
 * Minisim: agents try to reach a goal before slower defenders catch them (D6.1, section 7.2.1).
 *
 * <p>The results are bit-identical to those of Swarmwright's built-in Minisim: every operation is
 * one of IEEE 754 binary32 in the order written, until the fitness, which is summed in binary64.
 * Sensors of an agent: the way to the goal and to the closest defender, each by the size of the
 * map. Its actuator: the heading, as an angle by pi. Fitness: minus the mean distance to the goal
 * at the end, 0 for those that arrived.
 */
public final strictfp class Minisim implements Simulation {
  private static final Description DESCRIPTION =
      Description.of("minisim", 2, 4, 1)
          .withMaxAgents(Settings.MAX_BODIES)
          .withMetrics("arrived", "caught", "steps", "distance")
          .with(Description.Determinism.BITWISE);
  private static final int[] NO_AGENTS = {};

  private enum State {
    FREE,
    ARRIVED,
    CAUGHT
  }

  private Settings settings;
  private float[][] agents;
  private float[][] defenders;
  private State[] states;
  private int[] free;
  private long step;

  /** At the start of an episode of D6.1's example. */
  public Minisim() {
    reset(new ParameterReader(new JsonObject()));
  }

  @Override
  public Description description() {
    return DESCRIPTION;
  }

  @Override
  public void reset(ParameterReader parameters) {
    settings = new Settings(parameters);
    agents = settings.agents;
    defenders = settings.defenders;
    states = new State[agents.length];
    Arrays.fill(states, State.FREE);
    free = new int[agents.length];
    Arrays.setAll(free, i -> i);
    step = 0;
  }

  @Override
  public int[] acting() {
    return settings.rule == null ? free : NO_AGENTS;
  }

  @Override
  public boolean done() {
    return free.length == 0;
  }

  @Override
  public void sense(int agent, float[] sensors) {
    float x = agents[agent][0];
    float y = agents[agent][1];
    sensors[0] = (settings.goal[0] - x) / settings.width;
    sensors[1] = (settings.goal[1] - y) / settings.height;
    float[] defender = closestDefender(agents[agent]);
    sensors[2] = defender == null ? 0f : (defender[0] - x) / settings.width;
    sensors[3] = defender == null ? 0f : (defender[1] - y) / settings.height;
  }

  @Override
  public void step(float[] actuators) {
    if (free.length == 0) {
      return;
    }
    for (int i = 0; i < free.length; i++) {
      if (settings.rule != null) {
        moveByRule(agents[free[i]]);
      } else {
        move(agents[free[i]], Functions.cosPi(actuators[i]), Functions.sinPi(actuators[i]));
      }
    }
    for (float[] defender : defenders) {
      pursue(defender);
    }
    for (int agent : free) {
      judge(agent);
    }
    step++;
    free =
        step >= settings.maxSteps
            ? NO_AGENTS
            : Arrays.stream(free).filter(i -> states[i] == State.FREE).toArray();
  }

  @Override
  public double fitness() {
    double sum = 0;
    for (int i = 0; i < agents.length; i++) {
      if (states[i] != State.ARRIVED) {
        sum += distance(agents[i], settings.goal);
      }
    }
    return 0.0 - sum / agents.length;
  }

  @Override
  public double[] metrics() {
    return new double[] {count(State.ARRIVED), count(State.CAUGHT), step, 0.0 - fitness()};
  }

  private double count(State target) {
    return Arrays.stream(states).filter(state -> state == target).count();
  }

  @Override
  public Scene scene() {
    Scene scene = new Scene(settings.width, settings.height).message(settings.helloMessage);
    scene.body("goal", settings.goal[0], settings.goal[1]).radius(settings.goalRadius);
    for (float[] defender : defenders) {
      scene.body("defender", defender[0], defender[1]).radius(settings.captureRadius);
    }
    for (int i = 0; i < agents.length; i++) {
      String state = states[i].name().toLowerCase(Locale.ROOT);
      scene.body("agent", agents[i][0], agents[i][1]).state(state);
    }
    return scene;
  }

  @Override
  public String picture() {
    return Picture.draw(settings, step, agents, defenders);
  }

  @Override
  public int pictureMillis() {
    return settings.stepSize;
  }

  private void move(float[] agent, float x, float y) {
    agent[0] = limit(agent[0] + settings.speedAgents * x, settings.width);
    agent[1] = limit(agent[1] + settings.speedAgents * y, settings.height);
  }

  private void moveByRule(float[] agent) {
    float[] way = settings.rule.way(agent, settings.goal, closestDefender(agent));
    float n = (float) Math.sqrt(way[0] * way[0] + way[1] * way[1]);
    if (n > 0f) {
      move(agent, way[0] / n, way[1] / n);
    }
  }

  /** A defender goes towards the closest free agent, the first of several. */
  private void pursue(float[] defender) {
    float[] target = null;
    float least = 0f;
    for (int agent : free) {
      float q = squaredDistance(defender, agents[agent]);
      if (target == null || q < least) {
        target = agents[agent];
        least = q;
      }
    }
    float d = (float) Math.sqrt(least);
    float x = target[0];
    float y = target[1];
    if (d > settings.speedDefenders) {
      float f = settings.speedDefenders / d;
      float dx = target[0] - defender[0];
      float dy = target[1] - defender[1];
      x = defender[0] + dx * f;
      y = defender[1] + dy * f;
    }
    defender[0] = x;
    defender[1] = y;
  }

  private void judge(int agent) {
    float[] defender = closestDefender(agents[agent]);
    if (distance(agents[agent], settings.goal) <= settings.goalRadius) {
      states[agent] = State.ARRIVED;
    } else if (defender != null && distance(agents[agent], defender) <= settings.captureRadius) {
      states[agent] = State.CAUGHT;
    }
  }

  private float[] closestDefender(float[] agent) {
    float[] closest = null;
    float least = 0f;
    for (float[] defender : defenders) {
      float q = squaredDistance(agent, defender);
      if (closest == null || q < least) {
        closest = defender;
        least = q;
      }
    }
    return closest;
  }

  private static float squaredDistance(float[] from, float[] to) {
    float dx = to[0] - from[0];
    float dy = to[1] - from[1];
    return dx * dx + dy * dy;
  }

  /**
   * The square root of a binary32, taken in binary64, rounds to that of binary32 (Figueroa 1995).
   */
  static float distance(float[] from, float[] to) {
    return (float) Math.sqrt(squaredDistance(from, to));
  }

  private static float limit(float value, float high) {
    float v = value < 0f ? 0f : value;
    return v > high ? high : v;
  }
}
