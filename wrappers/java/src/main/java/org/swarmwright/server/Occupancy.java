package org.swarmwright.server;

import java.util.Objects;
import java.util.Optional;
import org.swarmwright.messages.Discovery;

/**
 * Which optimization tool has a server, and what the server computes for it.
 *
 * <p>A server is free, configured (parameters came, it waits for control), running an episode,
 * stepping a batch, working on requests for offloaded evaluation, or held: between two episodes of
 * a tool that gave its name it stays reserved for that tool for a moment (docs/decisions/004), and
 * so it does for one whose turn has come ({@link Turns}). Times are nanoseconds of {@link
 * System#nanoTime}.
 */
final class Occupancy {
  /** How long a server stays configured without control, or held without another episode. */
  private static final long IDLE_LIMIT_NANOS = 5_000_000_000L;

  /** See the class. */
  enum State {
    FREE,
    CONFIGURED,
    RUNNING,
    STEPPING,
    WORKING,
    HELD
  }

  private final Offer offer;
  private final DiscoveryReplies discoveryReplies;
  private final PresencePublisher presence;
  private final Turns turns = new Turns();

  private State state = State.FREE;

  /** When the server is free again, while configured or held. */
  private long until;

  /** When it became what it is, as far as was known when the message came in. */
  private long changedAt;

  /** While running. */
  private Run run;

  /** While stepping. */
  private Batch batch;

  /** While working. */
  private EvaluationQueue evaluations;

  /** The tool for which the server is held; null for an unnamed one. */
  private String heldFor;

  /** The hash of the run before, which a control{run: false} may still name. */
  private String lastHash;

  Occupancy(Offer offer, DiscoveryReplies discoveryReplies, PresencePublisher presence) {
    this.offer = offer;
    this.discoveryReplies = discoveryReplies;
    this.presence = presence;
  }

  boolean is(State other) {
    return state == other;
  }

  State state() {
    return state;
  }

  /** The episode that is running, else null. */
  Run run() {
    return run;
  }

  /** The batch that is being stepped, else null. */
  Batch batch() {
    return batch;
  }

  /** The requests that are being computed, else null. */
  EvaluationQueue evaluations() {
    return evaluations;
  }

  /** The hash of the run before; null if there was none. */
  String lastHash() {
    return lastHash;
  }

  /** Whether something is being computed. */
  boolean isActive() {
    return state == State.RUNNING || state == State.STEPPING || state == State.WORKING;
  }

  /** Whether the server is held for another tool than this; null for an unnamed one. */
  boolean isHeldForOther(String tool) {
    return state == State.HELD && !Objects.equals(heldFor, tool);
  }

  /** Whether the server is held for a tool without a name. */
  boolean isHeldForUnnamed() {
    return state == State.HELD && heldFor == null;
  }

  /** The tool that has the server; null if none, or an unnamed one, has it. */
  String holder() {
    switch (state) {
      case RUNNING:
        return run.tool;
      case STEPPING:
        return batch.start.tool;
      case WORKING:
        return evaluations.tool();
      case HELD:
        return heldFor;
      default:
        return null;
    }
  }

  String holderInWords() {
    return holder() == null ? "another optimization tool" : holder();
  }

  /** Whether a tool may have the server. One that may not is remembered, and has its turn later. */
  boolean admits(Discovery discovery, long now) {
    String tool = discovery.getTool();
    boolean heldForIt = state == State.HELD && !isHeldForOther(tool);
    if (state == State.FREE || heldForIt) {
      if (tool == null) {
        turns.removeQuestions(null);
      }
      return true;
    }
    if (!turns.isHeldBy(tool)) {
      turns.ask(discovery, now);
    }
    return false;
  }

  /** Parameters for this server came in. */
  void configured(long now) {
    if (state == State.FREE || state == State.CONFIGURED) {
      enter(State.CONFIGURED, now);
      until = now + IDLE_LIMIT_NANOS;
    } else if (isHeldForUnnamed()) {
      // Parameters do not name their tool; most likely they are those of the awaited one.
      until = now + IDLE_LIMIT_NANOS;
    }
  }

  /** Parameters for another server came in: an unnamed tool that was invited may have chosen it. */
  void otherConfigured(String hash, long now) {
    boolean choseOther = turns.choseOther(hash);
    if (choseOther && isHeldForUnnamed()) {
      enter(State.FREE, now);
      presence.changedForLong(now);
    }
  }

  /** An episode begins. */
  void begin(Run started, long now) {
    change(State.RUNNING, now);
    run = started;
    activated(now);
  }

  /** A batch begins. */
  void begin(Batch started, long now) {
    change(State.STEPPING, now);
    batch = started;
    activated(now);
  }

  /** Requests for offloaded evaluation begin. */
  void begin(EvaluationQueue started, long now) {
    change(State.WORKING, now);
    evaluations = started;
    activated(now);
  }

  /** A tool takes over the queue of one that gave up while an evaluation is being stopped. */
  void queueTakenOver(long now) {
    presence.changed(now);
    activated(now);
  }

  private void activated(long now) {
    turns.heldBy(Optional.ofNullable(holder()), true, now);
  }

  /** Gives up what is under way; an evaluation, as soon as it can be stopped. */
  void giveUp(long now) {
    if (state == State.WORKING) {
      evaluations.giveUp();
    } else {
      free(now);
    }
  }

  /**
   * A run is over: its tool, if it gave its name, keeps the server for the next one, unless it is
   * another one's turn. An unnamed tool that had to wait for its turn keeps the server until the
   * turn is over.
   */
  void finish(long now) {
    Discovery next = turns.next(now);
    String tool = holder();
    if (next != null) {
      handOver(next, now);
    } else if (tool != null) {
      hold(tool, now);
    } else if (turns.keepsUnnamed(now)) {
      hold(null, now + Turns.UNNAMED_RESERVATION_NANOS, now);
    } else {
      free(now);
    }
  }

  /** The tool whose turn it is now, if another one waits and the turn is over; else null. */
  Discovery nextTurn(long now) {
    return turns.next(now);
  }

  /**
   * Reserves the server for a tool. One with a name learns of it by presence, an unnamed one by the
   * reply to its discovery.
   */
  void handOver(Discovery next, long now) {
    hold(next.getTool(), now + Turns.reservationNanos(next.getTool()), now);
    if (next.getTool() == null) {
      turns.invite(next.getSimulationHash());
      discoveryReplies.send(next);
    }
    presence.changedForLong(now);
  }

  /** Keeps the server for another episode of a tool. */
  void hold(String tool, long now) {
    hold(tool, now + IDLE_LIMIT_NANOS, now);
  }

  private void hold(String tool, long end, long now) {
    change(State.HELD, now);
    heldFor = tool;
    until = end;
    turns.heldBy(Optional.ofNullable(tool), false, now);
  }

  /** See {@link Machine#computed}. */
  void computed(long turn, long now) {
    if (state == State.HELD && changedAt == turn) {
      until += now - turn;
    }
  }

  /** The server is free. */
  void free(long now) {
    enter(State.FREE, now);
  }

  private void enter(State next, long now) {
    change(next, now);
    turns.heldBy(null, next == State.CONFIGURED, now);
  }

  private void change(State next, long now) {
    if (state == State.RUNNING) {
      lastHash = run.hash;
    }
    if (next == State.FREE) {
      offer.discardDuplicates();
    }
    state = next;
    run = null;
    batch = null;
    evaluations = null;
    heldFor = null;
    changedAt = now;
    presence.changed(now);
  }

  /** When waiting for control or another episode ends; null if the server does not wait for it. */
  Long expiry() {
    return state == State.CONFIGURED || state == State.HELD ? (Long) until : null;
  }
}
