package org.swarmwright;

/**
 * An environment that can be reset and stepped. One object runs one episode after another.
 *
 * <p>An episode: {@link #reset}, then, until it is {@link #done}, {@link #sense} for every acting
 * agent and {@link #step} with their actuators; then {@link #fitness}. The same parameters and
 * actuators must give the same sensors and fitness, to the bit.
 *
 * <p>An exception or error ends the episode and is reported to the optimization tool with message
 * and stack. The server stays usable: the next episode begins with {@link #reset}.
 */
public interface Simulation {
  /** The properties of the simulation, which do not change. */
  Description description();

  /**
   * Goes to the start of an episode.
   *
   * @param parameters the values that the experiment sets; missing parameters take their defaults;
   *     the server warns of those that this method does not read
   * @throws ParameterException if a value cannot be used; {@link ParameterReader} throws it, with
   *     the reason
   */
  void reset(ParameterReader parameters);

  /**
   * The agents whose actuators the next step needs, ascending from 0; none when the episode has
   * ended.
   */
  int[] acting();

  /**
   * Whether the episode has ended. A simulation that steers its agents itself has no acting agents
   * before: it is stepped without actuators.
   */
  default boolean done() {
    return acting().length == 0;
  }

  /** Writes the sensors of an acting agent: finite numbers, as many as the description says. */
  void sense(int agent, float[] sensors);

  /**
   * Makes one step.
   *
   * @param actuators (acting agents, actuators), row-major, in the order of {@link #acting}; each
   *     number is in -1..1
   */
  void step(float[] actuators);

  /** Fitness of the episode so far, a finite number; larger is better. */
  double fitness();

  /**
   * Metrics of the episode, in the order of the description's names, and as many; an experiment can
   * define its fitness from them.
   */
  default double[] metrics() {
    return new double[0];
  }

  /**
   * What the episode looks like now, for tools that show it elsewhere; null if there is nothing to
   * see. Servers announce scenes if this method is overridden.
   */
  default Scene scene() {
    return null;
  }

  /** The current state as lines of text to be read; null if there is nothing to show. */
  default String picture() {
    return null;
  }

  /** Milliseconds between two pictures or scenes. */
  default int pictureMillis() {
    return 250;
  }
}
