package org.swarmwright.server;

/**
 * How long a step may wait for actuators: after a while the operator is warned, then the episode or
 * batch is given up. Times are nanoseconds of {@link System#nanoTime}.
 */
final class StepTimeout {
  private static final long WARN_AFTER_NANOS = 5_000_000_000L;

  private final long nanos;

  StepTimeout(double seconds) {
    nanos = (long) (seconds * 1e9);
  }

  /** When a step that waits since a time has to be looked at. */
  long deadline(long since, boolean warned) {
    return since + (warned ? nanos : Math.min(WARN_AFTER_NANOS, nanos));
  }

  boolean isOver(long since, long now) {
    return now - since >= nanos;
  }

  boolean isWarningDue(long since, long now) {
    return now - since >= WARN_AFTER_NANOS;
  }
}
