package org.swarmwright.server;

import java.util.List;
import org.swarmwright.ParameterException;
import org.swarmwright.ParameterReader;
import org.swarmwright.Simulation;

/** Calls the simulation's code so that its exceptions fail the episode, not the server. */
final class Guard {
  private static final int MAX_FRAMES = 32;
  private static final int MAX_REASON = 2000;
  private static final int MAX_STACK = 8000;

  private Guard() {}

  /** An episode has failed; the message says in which line of code, if that is known. */
  static final class EpisodeFailed extends Exception {
    private static final long serialVersionUID = 1L;

    /** What the simulation threw, with the frames of its code; null if it threw nothing. */
    final String stack;

    /** Whether it would fail again with the same parameters and seed, for any tool. */
    final boolean invalid;

    EpisodeFailed(String reason) {
      this(reason, false);
    }

    EpisodeFailed(String reason, boolean invalid) {
      super(reason, null, false, false);
      this.invalid = invalid;
      stack = null;
    }

    EpisodeFailed(Throwable cause) {
      super(
          shortened("the simulation threw " + cause + place(cause), MAX_REASON),
          null,
          false,
          false);
      invalid = false;
      stack = shortened(describe(cause), MAX_STACK);
    }
  }

  /** Code of the simulation, with a result. */
  interface Code<T> {
    T run() throws EpisodeFailed;
  }

  /**
   * Calls the simulation.
   *
   * @throws EpisodeFailed if it throws anything
   */
  static <T> T call(Code<T> code) throws EpisodeFailed {
    try {
      return code.run();
    } catch (EpisodeFailed failed) {
      throw failed;
    } catch (Throwable error) {
      // Checked exceptions, too: Kotlin and Lombok throw them undeclared.
      throw new EpisodeFailed(error);
    }
  }

  /** As {@link #call}, without a result. */
  static void run(Runnable code) throws EpisodeFailed {
    call(
        () -> {
          code.run();
          return null;
        });
  }

  /**
   * Resets the simulation.
   *
   * @param unread told of the parameters that it does not read
   * @throws ParameterException if it refuses a parameter
   * @throws EpisodeFailed if it throws anything else
   */
  static void reset(Simulation simulation, ParameterReader parameters, Unread unread)
      throws EpisodeFailed {
    try {
      simulation.reset(parameters);
    } catch (ParameterException error) {
      throw error;
    } catch (Throwable error) {
      throw new EpisodeFailed(error);
    }
    unread.check(parameters);
  }

  /**
   * Checks that a fitness can be sent.
   *
   * @throws EpisodeFailed if it is NaN or infinite
   */
  static double finite(double fitness) throws EpisodeFailed {
    if (!Double.isFinite(fitness)) {
      throw new EpisodeFailed("the simulation's fitness is " + fitness + ", not a finite number");
    }
    return fitness;
  }

  /**
   * All metrics of the episode.
   *
   * @throws EpisodeFailed if they are not as many as the description's names
   */
  static double[] metrics(Simulation simulation) throws EpisodeFailed {
    int names = simulation.description().metrics().size();
    double[] all = names == 0 ? new double[0] : call(simulation::metrics);
    if (all == null || all.length != names) {
      String actual = all == null ? "null" : all.length + " numbers";
      throw new EpisodeFailed(
          "metrics() gives " + actual + ", but the description has " + names + " names");
    }
    return all;
  }

  /**
   * The fitness of an episode that has ended, followed by the metrics with these names.
   *
   * @throws EpisodeFailed if one is NaN or infinite, metrics are missing or too many, or the
   *     simulation throws
   */
  static double[] results(Simulation simulation, List<String> names) throws EpisodeFailed {
    double[] results = new double[1 + names.size()];
    results[0] = finite(call(simulation::fitness));
    // Also where none are wanted: whether an episode fails must not depend on the mode.
    double[] all = metrics(simulation);
    List<String> available = simulation.description().metrics();
    for (int i = 0; i < names.size(); i++) {
      int index = available.indexOf(names.get(i));
      results[1 + i] = all[index];
      if (!Double.isFinite(results[1 + i])) {
        throw new EpisodeFailed(
            "the simulation's metric "
                + names.get(i)
                + " is "
                + results[1 + i]
                + ", not a finite number");
      }
    }
    return results;
  }

  /** Message and stack, down to the call by this library. */
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

  /** The first line outside of Java's class library: most likely that of the bug. */
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

  /** A text of at most this many characters; one that is cut ends in "...". */
  static String shortened(String text, int most) {
    if (text.codePointCount(0, text.length()) <= most) {
      return text;
    }
    return text.substring(0, text.offsetByCodePoints(0, most - 3)) + "...";
  }

  private static void append(StringBuilder text, StackTraceElement[] stack) {
    int shown = 0;
    for (StackTraceElement frame : stack) {
      if (frame.getClassName().startsWith("org.swarmwright.server.") || shown++ == MAX_FRAMES) {
        break;
      }
      text.append("\n    at ").append(frame);
    }
  }
}
