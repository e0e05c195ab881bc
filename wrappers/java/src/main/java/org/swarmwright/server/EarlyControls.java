package org.swarmwright.server;

import java.util.ArrayDeque;
import java.util.ArrayList;
import java.util.Deque;
import java.util.Iterator;
import java.util.List;
import java.util.Objects;
import org.swarmwright.messages.Control;

/**
 * Control messages that came before their parameters. MQTT keeps the order within a topic, but not
 * all brokers keep it across topics. Times are nanoseconds of {@link System#nanoTime}.
 */
final class EarlyControls {
  /** How long a control message waits for its parameters. */
  static final long MAX_WAIT_NANOS = 1_000_000_000L;

  /** Messages that are kept: few tools ask at once. */
  private static final int MAX_KEPT = 8;

  private static final class Waiting {
    final Control control;
    final long until;

    Waiting(Control control, long until) {
      this.control = control;
      this.until = until;
    }
  }

  /** The oldest first. */
  private final Deque<Waiting> waiting = new ArrayDeque<>();

  void keep(Control control, long now) {
    forget(control);
    if (waiting.size() >= MAX_KEPT) {
      waiting.removeFirst();
    }
    waiting.addLast(new Waiting(control, now + MAX_WAIT_NANOS));
  }

  /**
   * Removes the messages of a tool for an episode, and keeps those of other tools for it.
   *
   * @param control a message of that tool for that episode
   */
  void forget(Control control) {
    waiting.removeIf(
        one ->
            one.control.getSimulationHash().equals(control.getSimulationHash())
                && Objects.equals(one.control.getTool(), control.getTool()));
  }

  /**
   * Removes and returns a message that waits for the parameters of a hash; null if there is none.
   */
  Control take(String hash) {
    for (Iterator<Waiting> all = waiting.iterator(); all.hasNext(); ) {
      Control control = all.next().control;
      if (control.getSimulationHash().equals(hash)) {
        all.remove();
        return control;
      }
    }
    return null;
  }

  void clear() {
    waiting.clear();
  }

  /** When the next one has waited for too long; null for none. */
  Long nextTick() {
    return waiting.isEmpty() ? null : (Long) waiting.peekFirst().until;
  }

  /** Removes and returns those that have waited for too long. */
  List<Control> removeLate(long now) {
    List<Control> late = new ArrayList<>();
    while (!waiting.isEmpty() && waiting.peekFirst().until <= now) {
      late.add(waiting.removeFirst().control);
    }
    return late;
  }
}
