package org.swarmwright.server;

import java.util.ArrayDeque;
import java.util.ArrayList;
import java.util.Deque;
import java.util.Iterator;
import java.util.List;
import java.util.Objects;
import org.swarmwright.messages.Control;

/**
 * Control messages that came before their parameters. MQTT keeps the order within a topic; across
 * topics not all brokers do. Times are nanoseconds of {@link System#nanoTime}.
 */
final class Early {
  /** How long a control message waits for its parameters. */
  static final long OVERTAKEN = 1_000_000_000L;

  /** Messages that are kept: of the tools on a broker, few ask at once. */
  private static final int KEPT = 8;

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
    if (waiting.size() >= KEPT) {
      waiting.removeFirst();
    }
    waiting.addLast(new Waiting(control, now + OVERTAKEN));
  }

  /**
   * Forgets what a tool has sent for an episode; what another one has sent for it waits on.
   *
   * @param control any message of that tool for that episode
   */
  void forget(Control control) {
    waiting.removeIf(
        one ->
            one.control.getSimulationHash().equals(control.getSimulationHash())
                && Objects.equals(one.control.getTool(), control.getTool()));
  }

  /** Takes out what waits for the parameters of a hash; null for nothing. */
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

  /** When the next one has waited for long enough; null for none. */
  Long next() {
    return waiting.isEmpty() ? null : (Long) waiting.peekFirst().until;
  }

  /** Takes out those that have waited for long enough. */
  List<Control> late(long now) {
    List<Control> late = new ArrayList<>();
    while (!waiting.isEmpty() && waiting.peekFirst().until <= now) {
      late.add(waiting.removeFirst().control);
    }
    return late;
  }
}
