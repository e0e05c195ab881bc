package org.swarmwright;

/**
 * An environment that can be reset and stepped. One object runs one episode at a time, any number
 * of them in turn.
 *
 * <p>An episode: {@link #reset}, then, until it is {@link #done}, {@link #sense} for every acting
 * agent and {@link #step} with what they do; then {@link #fitness}. The same parameters and
 * actuators must give the same sensors and fitness, to the bit.
 *
 * <p>Whatever a method throws ends the episode, is told to the optimization tool with message and
 * stack, and leaves the server usable: the next episode begins with {@link #reset} as any other.
 */
public interface Simulation {
  /** What the simulation offers; the same at any time. */
  Description description();

  /**
   * Goes to the start of an episode.
   *
   * @param parameters what the experiment sets; parameters left out take their defaults, unknown
   *     ones are ignored
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
   * Whether the episode has ended. A simulation that steers its agents itself lets nobody act
   * before: it is stepped without actuators.
   */
  default boolean done() {
    return acting().length == 0;
  }

  /** Writes what an acting agent senses: finite numbers, as many as the description says. */
  void sense(int agent, float[] sensors);

  /**
   * Moves on by one step.
   *
   * @param actuators a row for each acting agent, in the order of {@link #acting}, one behind the
   *     other; each number is in -1..1
   */
  void step(float[] actuators);

  /** Fitness of the episode so far, a finite number; larger is better. */
  double fitness();

  /**
   * What else is measured in the episode, in the order of the description's names: an experiment
   * can make a fitness of it.
   */
  default double[] metrics() {
    return new double[0];
  }

  /** What there is to see now, as lines of text for people; null if there is nothing to show. */
  default String picture() {
    return null;
  }

  /** Milliseconds between two pictures. */
  default int pictureMillis() {
    return 250;
  }
}
