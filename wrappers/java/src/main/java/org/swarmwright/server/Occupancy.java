package org.swarmwright.server;

import java.util.HashSet;
import java.util.List;
import java.util.Objects;
import java.util.Optional;
import java.util.Set;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Discovery;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Presence;
import org.swarmwright.messages.Server;
import org.swarmwright.messages.Swarmwright;
import org.swarmwright.messages.Topics.Topic;

/**
 * Who has a server, and what it says of itself.
 *
 * <p>A server is free, configured (parameters came, it waits for control), running an episode,
 * stepping a batch, working on requests for offloaded evaluation, or held: between two episodes of
 * a tool that gave its name it stays reserved for that tool for a moment (docs/decisions/004), and
 * so it does for one whose turn has come ({@link Turns}). Times are nanoseconds of {@link
 * System#nanoTime}.
 */
abstract class Occupancy {
  static final long SECOND = 1_000_000_000L;

  /**
   * How long parameters without control, or a holder without a new episode, keep the server taken.
   */
  static final long PATIENCE = 5 * SECOND;

  /**
   * A change of presence is published when it has lasted this long: runs of a few milliseconds are
   * no news.
   */
  static final long SETTLE = 150_000_000L;

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

  /** The tool for which it is held; null for one without a name. */
  String holder;

  /** The hash of the run before, which a control{run: false} may still name. */
  String lastHash;

  /** For how long it may turn out that another server with the ID is gone. */
  static final long LISTEN = SECOND / 10;

  /** Another server that has the ID and is to keep it, in words; null for none. */
  String leavingTo;

  private String leavingFrom;

  /** When this server leaves to it. */
  long leavingAt;

  /** Since when presence has to be published; null if it is known. */
  Long changedAt;

  final Turns turns = new Turns();

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

  /**
   * A run is over: its tool, if it gave its name, keeps the server for the next one, unless it is
   * another one's turn. A tool without a name keeps it for as long as its turn lasts, where it had
   * to wait for that.
   */
  void leave(long now) {
    Discovery next = turns.next(now);
    String tool = holder();
    if (next != null) {
      handOver(next, now);
    } else if (tool != null) {
      hold(tool, now + PATIENCE, now);
    } else if (turns.keepsNameless(now)) {
      hold(null, now + Turns.RESERVED_NAMELESS, now);
    } else {
      enter(State.FREE, now);
    }
  }

  /**
   * The server waits for a tool, which hears of it at once: one with a name by presence, one
   * without by the answer to its question.
   */
  final void handOver(Discovery next, long now) {
    hold(next.getTool(), now + Turns.patience(next.getTool()), now);
    if (next.getTool() == null) {
      turns.invite(next.getSimulationHash());
      answer(next);
    }
    tellAtOnce(now);
  }

  /** Tells a tool that it may have the server. */
  final void answer(Discovery discovery) {
    Server answer =
        new Server()
            .withServer(identity.id)
            .withSimulationHash(discovery.getSimulationHash())
            .withSimulations(titles())
            .withCapabilities(capabilities());
    outbox.publish(Topic.SERVER, Messages.write(answer));
  }

  /** The server is free, or configured. */
  final void enter(State next, long now) {
    change(next, now);
    turns.heldBy(null, next == State.CONFIGURED, now);
  }

  /** The server waits for a tool; null for one without a name. */
  final void hold(String tool, long end, long now) {
    change(State.HELD, now);
    holder = tool;
    until = end;
    turns.heldBy(Optional.ofNullable(tool), false, now);
  }

  /** An episode begins. */
  final void begin(Run started, long now) {
    change(State.RUNNING, now);
    run = started;
    hasBegun(now);
  }

  /** A batch begins. */
  final void begin(Batch started, long now) {
    change(State.STEPPING, now);
    batch = started;
    hasBegun(now);
  }

  /** Requests begin. */
  final void begin(Work started, long now) {
    change(State.WORKING, now);
    work = started;
    hasBegun(now);
  }

  /** Something is computed for whoever has the server. */
  final void hasBegun(long now) {
    turns.heldBy(Optional.ofNullable(holder()), true, now);
  }

  private void change(State next, long now) {
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

  /**
   * A presence message came in under this server's ID. Of two servers with one ID that are at work
   * the one whose instance is the greater text goes, and the other one says that it is there.
   */
  void otherPresence(Presence presence, long now) {
    if (presence.getServer() != identity.id) {
      return;
    }
    if (presence.getState() == Presence.State.LOST) {
      // A last will, an old one of this server or that of another with its ID, stands in the place
      // of what is true.
      Swarmwright gone = presence.getCapabilities().getSwarmwright();
      if (gone != null && leavingTo != null && leavingFrom.equals(gone.getInstance())) {
        leavingTo = null;
      }
      forgetPresence();
      publishPresence(presence.getSince());
      return;
    }
    Swarmwright other = presence.getCapabilities().getSwarmwright();
    if (other != null && identity.instance.equals(other.getInstance())) {
      return;
    }
    String rival = Identity.words(other);
    if (identity.isDead(other)) {
      return;
    }
    leavingTo = null;
    if (other != null
        && other.getInstance() != null
        && other.getInstance().compareTo(identity.instance) < 0) {
      // What comes late may be of one that is gone by now: that would come right behind it.
      leavingTo = rival;
      leavingFrom = other.getInstance();
      leavingAt = now + LISTEN;
      return;
    }
    complain(
        String.format(
            "another server has the id %d too (%s); give one of them another --id",
            identity.id, rival));
    forgetPresence();
    tellAtOnce(now);
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

  /** A change of presence that is no matter of milliseconds. */
  final void tellAtOnce(long now) {
    changedAt = now - SETTLE;
  }

  /** Nobody knows any more what the server does. */
  void forgetPresence() {
    published = null;
  }
}
