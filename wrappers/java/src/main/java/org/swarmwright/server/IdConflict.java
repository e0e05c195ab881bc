package org.swarmwright.server;

import org.swarmwright.messages.Presence;
import org.swarmwright.messages.Swarmwright;

/**
 * Detects other running servers with this server's ID. Of two, the one whose instance is the
 * greater text leaves, and the other one publishes its presence again. Times are nanoseconds of
 * {@link System#nanoTime}.
 */
final class IdConflict {
  /** How long to wait for news that the other server is lost before leaving. */
  private static final long CONFIRM_NANOS = 100_000_000L;

  private final Identity identity;
  private final Warnings warnings;

  /** The server that keeps the ID, in words; null if there is none. */
  private String rival;

  private String rivalInstance;
  private long leaveAt;

  IdConflict(Identity identity, Warnings warnings) {
    this.identity = identity;
    this.warnings = warnings;
  }

  /** A last will came in under the ID: it may be that of the other server. */
  void lost(Presence presence) {
    Swarmwright gone = presence.getCapabilities().getSwarmwright();
    if (gone != null && rival != null && rivalInstance.equals(gone.getInstance())) {
      rival = null;
    }
  }

  /**
   * The presence of a running server came in under the ID.
   *
   * @return whether the other server is to leave, and therefore has to receive the presence of this
   *     one
   */
  boolean isToLeave(Presence presence, long now) {
    Swarmwright other = presence.getCapabilities().getSwarmwright();
    boolean same = other != null && identity.instance.equals(other.getInstance());
    if (same || identity.isDead(other)) {
      return false;
    }
    rival = null;
    String words = Identity.words(other);
    if (other != null
        && other.getInstance() != null
        && other.getInstance().compareTo(identity.instance) < 0) {
      // A late message may be that of a server which is lost by now: its last will follows at once.
      rival = words;
      rivalInstance = other.getInstance();
      leaveAt = now + CONFIRM_NANOS;
      return false;
    }
    warnings.warnOnce(
        String.format(
            "another server has the id %d too (%s); give one of them another --id",
            identity.id, words));
    return true;
  }

  /** Without a connection, nothing is known of other servers. */
  void disconnected() {
    rival = null;
  }

  /** When this server leaves; null for never. */
  Long nextTick() {
    return rival == null ? null : (Long) leaveAt;
  }

  /** The server for which this one leaves now, in words; null if it stays. */
  String rivalToLeaveFor(long now) {
    return rival != null && leaveAt <= now ? rival : null;
  }
}
