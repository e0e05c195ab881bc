package org.swarmwright.server;

import java.util.HashSet;
import java.util.Set;

/** Warnings for the operator, each of which is given once, however often its cause comes back. */
final class Warnings {
  private static final int MAX_REMEMBERED = 1000;

  private final Outbox outbox;
  private final Set<String> shown = new HashSet<>();

  Warnings(Outbox outbox) {
    this.outbox = outbox;
  }

  void warnOnce(String text) {
    if (shown.size() < MAX_REMEMBERED && shown.add(text)) {
      outbox.notice("warning: " + text);
    }
  }
}
