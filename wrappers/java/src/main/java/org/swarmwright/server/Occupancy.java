package org.swarmwright.server;

import java.util.HashSet;
import java.util.List;
import java.util.Objects;
import java.util.Set;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Presence;
import org.swarmwright.messages.Swarmwright;

/**
 * Who has a server, and what it says of itself.
 *
 * <p>A server is free, configured (parameters came, it waits for control), running an episode,
 * stepping a batch, working on requests for offloaded evaluation, or held: between two episodes of
 * a tool that gave its name it stays reserved for that tool for a moment (docs/decisions/004).
 * Times are nanoseconds of {@link System#nanoTime}.
 */
abstract class Occupancy {
  static final long SECOND = 1_000_000_000L;

  /**
   * How long parameters without control, or a holder without a new episode, keep the server taken.
   */
  static final long PATIENCE = 5 * SECOND;

  private static final int MOST_COMPLAINTS = 1000;

  /** See the class. */
  enum State {
    FREE,
    CONFIGURED,
    RUNNING,
    STEPPING,
    WORKING,
    HELD
  }

  final Identity identity;
  final Offer offer;
  final Outbox outbox;

  State state = State.FREE;

  /** When the server is free again, while configured or held. */
  long until;

  /** While running. */
  Run run;

  /** While stepping. */
  Batch batch;

  /** While working. */
  Work work;

  /** The tool for which it is held. */
  String holder;

  /** The hash of the run before, which a control{run: false} may still name. */
  String lastHash;

  /** Since when presence has to be published; null if it is known. */
  Long changedAt;

  private final Set<String> complaints = new HashSet<>();
  private Presence.State published;
  private String publishedHolder;

  Occupancy(Identity identity, Offer offer, Outbox outbox) {
    this.identity = identity;
    this.offer = offer;
    this.outbox = outbox;
  }

  /** Gives up whatever is under way; what is being computed, as soon as it can be stopped. */
  void free(long now) {
    if (state == State.WORKING) {
      work.release();
    } else {
      enter(State.FREE, now);
    }
  }

  /** A run is over: its tool, if it gave its name, keeps the server for the next one. */
  void leave(long now) {
    String tool = holder();
    enter(tool == null ? State.FREE : State.HELD, now);
    holder = tool;
    until = now + PATIENCE;
  }

  void enter(State next, long now) {
    if (state == State.RUNNING) {
      lastHash = run.hash;
    }
    if (next == State.FREE) {
      offer.tidy();
    }
    state = next;
    run = null;
    batch = null;
    work = null;
    holder = null;
    if (changedAt == null) {
      changedAt = now;
    }
  }

  String holder() {
    switch (state) {
      case RUNNING:
        return run.tool;
      case STEPPING:
        return batch.start.tool;
      case WORKING:
        return work.holder();
      case HELD:
        return holder;
      default:
        return null;
    }
  }

  String holderInWords() {
    return holder() == null ? "another optimization tool" : holder();
  }

  List<String> titles() {
    return List.of(offer.description().title());
  }

  Capabilities capabilities() {
    return identity.capabilities(offer.description(), offer.batch());
  }

  /** The presence message for a state. */
  Presence presence(Presence.State now, String since) {
    return new Presence(identity.id, now, titles(), capabilities(), holder(), since);
  }

  /** Publishes what the server does now, unless that is known. */
  void publishPresence(String since) {
    changedAt = null;
    Presence.State now = state == State.FREE ? Presence.State.READY : Presence.State.BUSY;
    if (now == published && Objects.equals(holder(), publishedHolder)) {
      return;
    }
    outbox.presence(Messages.write(presence(now, since)));
    outbox.notice(
        now == Presence.State.READY ? "ready" : holder() == null ? "busy" : "busy for " + holder());
    published = now;
    publishedHolder = holder();
  }

  /** A presence message came in under this server's ID. */
  void otherPresence(Presence presence) {
    if (presence.getServer() != identity.id) {
      return;
    }
    if (presence.getState() == Presence.State.LOST) {
      // A last will, an old one of this server or that of another with its ID, stands in the place
      // of what is true.
      forgetPresence();
      publishPresence(presence.getSince());
      return;
    }
    Swarmwright other = presence.getCapabilities().getSwarmwright();
    if (other != null && identity.instance.equals(other.getInstance())) {
      return;
    }
    String host = other == null || other.getHost() == null ? "an unknown host" : other.getHost();
    complain(
        String.format(
            "another server has the id %d too (%s); give one of them another --id",
            identity.id, host));
  }

  /** A warning that is made only once, however often its cause comes back. */
  void complain(String text) {
    if (complaints.size() < MOST_COMPLAINTS && complaints.add(text)) {
      outbox.notice("warning: " + text);
    }
  }

  /** A tool that came too late hears of it, also when nothing has changed since. */
  void tellAgain(long now) {
    published = null;
    if (changedAt == null) {
      changedAt = now;
    }
  }

  /** Nobody knows any more what the server does. */
  void forgetPresence() {
    published = null;
  }
}
