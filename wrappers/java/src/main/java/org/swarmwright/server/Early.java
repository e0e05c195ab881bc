package org.swarmwright.server;

import java.util.ArrayList;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
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

  /** By hash, the oldest first. */
  private final Map<String, Waiting> waiting = new LinkedHashMap<>();

  void keep(Control control, long now) {
    take(control.getSimulationHash());
    if (waiting.size() >= KEPT) {
      waiting.remove(waiting.keySet().iterator().next());
    }
    waiting.put(control.getSimulationHash(), new Waiting(control, now + OVERTAKEN));
  }

  /** Takes out what waits for the parameters of a hash; null for nothing. */
  Control take(String hash) {
    Waiting found = waiting.remove(hash);
    return found == null ? null : found.control;
  }

  void clear() {
    waiting.clear();
  }

  /** When the next one has waited for long enough; null for none. */
  Long next() {
    return waiting.isEmpty() ? null : (Long) waiting.values().iterator().next().until;
  }

  /** Takes out those that have waited for long enough. */
  List<Control> late(long now) {
    List<Control> late = new ArrayList<>();
    for (Waiting one : new ArrayList<>(waiting.values())) {
      if (one.until <= now) {
        late.add(take(one.control.getSimulationHash()));
      }
    }
    return late;
  }
}
