package org.swarmwright.server;

import java.util.List;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.Simulation;

/** The simulation's code, called so that it cannot end the server. */
final class Guard {
  private static final int MOST_FRAMES = 16;
  private static final int MOST_CHARACTERS = 4000;

  private Guard() {}

  /** What the simulation threw, with message and stack. */
  static final class Broken extends Exception {
    private static final long serialVersionUID = 1L;

    Broken(String reason) {
      super(reason, null, false, false);
    }

    Broken(Throwable cause) {
      this("the simulation threw " + describe(cause));
    }
  }

  /** Code of the simulation, with a result. */
  interface Code<T> {
    T run() throws Broken;
  }

  /**
   * Calls the simulation.
   *
   * @throws Broken if it throws anything
   */
  static <T> T call(Code<T> code) throws Broken {
    try {
      return code.run();
    } catch (RuntimeException | LinkageError | AssertionError | VirtualMachineError error) {
      throw new Broken(error);
    }
  }

  /** As {@link #call}, without a result. */
  static void run(Runnable code) throws Broken {
    call(
        () -> {
          code.run();
          return null;
        });
  }

  /**
   * Resets the simulation.
   *
   * @throws ParameterException if it refuses a parameter
   * @throws Broken if it throws anything else
   */
  static void reset(Simulation simulation, ParameterReader parameters) throws Broken {
    try {
      simulation.reset(parameters);
    } catch (ParameterException error) {
      throw error;
    } catch (RuntimeException | LinkageError | AssertionError | VirtualMachineError error) {
      throw new Broken(error);
    }
  }

  /**
   * The fitness, if it can be sent.
   *
   * @throws Broken if it is NaN or infinite
   */
  static double finite(double fitness) throws Broken {
    if (!Double.isFinite(fitness)) {
      throw new Broken("the simulation's fitness is " + fitness + ", not a finite number");
    }
    return fitness;
  }

  /**
   * The fitness of the episode that has ended, and behind it the metrics with these names.
   *
   * @throws Broken if one is NaN or infinite, or the simulation throws
   */
  static double[] results(Simulation simulation, List<String> names) throws Broken {
    double[] results = new double[1 + names.size()];
    results[0] = finite(call(simulation::fitness));
    if (names.isEmpty()) {
      return results;
    }
    double[] all = call(simulation::metrics);
    List<String> known = simulation.description().metrics();
    for (int i = 0; i < names.size(); i++) {
      int index = known.indexOf(names.get(i));
      results[1 + i] = index < all.length ? all[index] : Double.NaN;
      if (!Double.isFinite(results[1 + i])) {
        throw new Broken(
            "the simulation's metric "
                + names.get(i)
                + " is "
                + results[1 + i]
                + ", not a finite number");
      }
    }
    return results;
  }

  /** Message and stack, down to where this library called. */
  private static String describe(Throwable error) {
    StringBuilder text = new StringBuilder(error.toString());
    append(text, error.getStackTrace());
    Throwable cause = error.getCause();
    if (cause != null && cause != error) {
      text.append("\nCaused by: ").append(cause);
      append(text, cause.getStackTrace());
    }
    return text.length() <= MOST_CHARACTERS
        ? text.toString()
        : text.substring(0, MOST_CHARACTERS) + "...";
  }

  private static void append(StringBuilder text, StackTraceElement[] stack) {
    int shown = 0;
    for (StackTraceElement frame : stack) {
      if (frame.getClassName().startsWith("org.swarmwright.server.") || shown++ == MOST_FRAMES) {
        break;
      }
      text.append("\n    at ").append(frame);
    }
  }
}
