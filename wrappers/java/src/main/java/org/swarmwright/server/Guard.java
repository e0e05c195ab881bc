package org.swarmwright.server;

import java.util.List;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.Simulation;

/** The simulation's code, called so that it cannot end the server. */
final class Guard {
  private static final int MOST_FRAMES = 32;
  private static final int MOST_REASON = 2000;
  private static final int MOST_STACK = 8000;

  private Guard() {}

  /** Why an episode is broken; the message says in which line, where that is known. */
  static final class Broken extends Exception {
    private static final long serialVersionUID = 1L;

    /** What the simulation threw, with the frames of its code; null if it threw nothing. */
    final String stack;

    /** Whether it would be so another time, too, whoever computes it with this server. */
    final boolean invalid;

    Broken(String reason) {
      this(reason, false);
    }

    Broken(String reason, boolean invalid) {
      super(reason, null, false, false);
      this.invalid = invalid;
      stack = null;
    }

    Broken(Throwable cause) {
      super(
          shortened("the simulation threw " + cause + place(cause), MOST_REASON),
          null,
          false,
          false);
      invalid = false;
      stack = shortened(describe(cause), MOST_STACK);
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
    return text.toString();
  }

  /** The first line outside of Java's own library, which is the one to look at. */
  private static String place(Throwable error) {
    for (StackTraceElement frame : error.getStackTrace()) {
      String name = frame.getClassName();
      boolean library = name.startsWith("java.") || name.startsWith("jdk.");
      if (!library && frame.getFileName() != null) {
        return " (" + frame.getFileName() + ":" + frame.getLineNumber() + ")";
      }
    }
    return "";
  }

  /** A text of at most as many characters; a cut is marked. */
  static String shortened(String text, int most) {
    if (text.codePointCount(0, text.length()) <= most) {
      return text;
    }
    return text.substring(0, text.offsetByCodePoints(0, most - 3)) + "...";
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
