package org.swarmwright.server;

import java.util.ArrayDeque;
import java.util.Deque;
import java.util.Objects;
import java.util.Optional;
import org.swarmwright.messages.Discovery;

/**
 * Turns: several optimization tools that want one server have it one after another.
 *
 * <p>A tool that asks for a server while another one has it is remembered. Between two episodes,
 * batches or requests of a tool whose turn is over, the server goes to the one that has waited
 * longest. Tools that know D6.1 alone have no name, and are one tool here: they get their turn as
 * others do. Since such a tool may ask only once, its question is good for longer, and is answered
 * when its turn comes. Times are nanoseconds of {@link System#nanoTime}.
 */
final class Turns {
  private static final long SECOND = 1_000_000_000L;

  /** How long a tool has a server for itself before another one gets it. */
  private static final long TURN = 5 * SECOND;

  /** For how long a question is still good: tools with a name ask every two seconds. */
  private static final long ASKED = 3 * SECOND;

  /** For how long that of a tool without a name is. */
  private static final long ASKED_ONCE = 30 * SECOND;

  /** How long a server waits for the tool whose turn it is. */
  private static final long RESERVED = 3 * SECOND;

  /** How long it waits for one without a name, at first and between two of its episodes. */
  static final long RESERVED_NAMELESS = SECOND;

  /** Tools that are remembered. */
  private static final int MOST = 256;

  /** A tool that asked in vain. */
  private static final class Question {
    final Discovery discovery;
    final long asked;

    Question(Discovery discovery, long asked) {
      this.discovery = discovery;
      this.asked = asked;
    }

    boolean isOf(String tool) {
      return Objects.equals(discovery.getTool(), tool);
    }

    boolean isGood(long now) {
      return now - asked < (discovery.getTool() == null ? ASKED_ONCE : ASKED);
    }
  }

  /** Who has the server, empty for a tool without a name; null for nobody. */
  private Optional<String> holder;

  private long since;

  /** The holder has not begun yet: waiting for it is no part of its turn. */
  private boolean reserved;

  /** The one that has waited longest first. */
  private final Deque<Question> waiting = new ArrayDeque<>();

  /** The hash of the discovery of a tool without a name that was answered when its turn came. */
  private String invited;

  /** A tool asked in vain. Asking again does not cost it its place. */
  void ask(Discovery discovery, long now) {
    Question question = new Question(discovery, now);
    boolean known = waiting.stream().anyMatch(one -> one.isOf(discovery.getTool()));
    if (known) {
      Deque<Question> before = new ArrayDeque<>(waiting);
      waiting.clear();
      before.forEach(one -> waiting.add(one.isOf(discovery.getTool()) ? question : one));
    } else if (waiting.size() < MOST) {
      waiting.add(question);
    }
  }

  /** Whether it is this tool that has the server; null for one without a name. */
  boolean isHeldBy(String tool) {
    return holder != null && holder.equals(Optional.ofNullable(tool));
  }

  /**
   * Who has the server from now on.
   *
   * @param next empty for a tool without a name; null for nobody, or somebody unknown
   * @param active whether something is being computed
   */
  void heldBy(Optional<String> next, boolean active, long now) {
    if (Objects.equals(holder, next) && !(active && reserved)) {
      return;
    }
    since = now;
    reserved = !active;
    if (next != null) {
      hasAskedEnough(next.orElse(null));
    }
    if (next == null || next.isPresent()) {
      invited = null;
    }
    holder = next;
  }

  /** A tool has an answer; null for one without a name. */
  void hasAskedEnough(String tool) {
    waiting.removeIf(question -> question.isOf(tool));
  }

  /** A tool without a name is answered, as its turn has come. */
  void invite(String hash) {
    invited = hash;
  }

  private boolean isOver(long now) {
    return now - since >= TURN;
  }

  /** Who is to have the server next, once the turn is over; null for nobody. */
  Discovery next(long now) {
    waiting.removeIf(question -> !question.isGood(now));
    if (!isOver(now) || waiting.isEmpty()) {
      return null;
    }
    return waiting.remove().discovery;
  }

  /** Whether the tool without a name that has the server had to wait for it, and goes on. */
  boolean keepsNameless(long now) {
    return invited != null && !isOver(now);
  }

  /** How long the server waits for a tool whose turn it is. */
  static long patience(String tool) {
    return tool == null ? RESERVED_NAMELESS : RESERVED;
  }

  /** A tool configured another server; whether this one need not wait for it any more. */
  boolean hasChosenAnother(String hash) {
    waiting.removeIf(
        question -> question.isOf(null) && hash.equals(question.discovery.getSimulationHash()));
    return reserved && hash.equals(invited);
  }
}
