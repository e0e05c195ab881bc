package org.swarmwright.server;

import java.util.Objects;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Presence;

/**
 * Publishes whether a server is ready or busy, when that has changed and lasts. Times are
 * nanoseconds of {@link System#nanoTime}.
 */
final class PresencePublisher {
  /**
   * A change is published when it has lasted this long: episodes of a few milliseconds are not
   * announced.
   */
  private static final long SETTLE_NANOS = 150_000_000L;

  private final Identity identity;
  private final Offer offer;
  private final Outbox outbox;

  /** Since when there is something to publish; null if there is not. */
  private Long changedAt;

  /** What the broker has; null if that is not known. */
  private Presence.State published;

  private String publishedHolder;

  /** Without a connection, what would be published is lost. */
  private boolean offline;

  PresencePublisher(Identity identity, Offer offer, Outbox outbox) {
    this.identity = identity;
    this.offer = offer;
    this.outbox = outbox;
  }

  /** The message for a state; {@code holder} is null if no tool, or an unnamed one, has it. */
  Presence message(Presence.State state, String holder, String since) {
    return new Presence(
        identity.id, state, offer.titles(), identity.capabilities(offer), holder, since);
  }

  /** The server's state has changed. */
  void changed(long now) {
    if (changedAt == null) {
      changedAt = now;
    }
  }

  /** A change that is published at the next tick. */
  void changedForLong(long now) {
    changedAt = now - SETTLE_NANOS;
  }

  /** The presence is published again after a while, even if it has not changed. */
  void repeat(long now) {
    forgetPublished();
    changed(now);
  }

  /** The presence on the broker may be another one than was published. */
  void forgetPublished() {
    published = null;
  }

  void connected() {
    offline = false;
  }

  void disconnected() {
    forgetPublished();
    offline = true;
  }

  /** When the presence has to be published; null for never. */
  Long nextTick() {
    return changedAt == null || offline ? null : (Long) (changedAt + SETTLE_NANOS);
  }

  /** Publishes the state, unless the broker has it. */
  void publish(Presence.State state, String holder, String since) {
    changedAt = null;
    if (state == published && Objects.equals(holder, publishedHolder)) {
      return;
    }
    outbox.presence(Messages.write(message(state, holder, since)));
    outbox.notice(
        state == Presence.State.READY ? "ready" : holder == null ? "busy" : "busy for " + holder);
    published = state;
    publishedHolder = holder;
  }
}
