package org.swarmwright.server;

import java.util.ArrayDeque;
import java.util.Deque;
import java.util.Objects;
import java.util.Optional;
import org.swarmwright.messages.Discovery;

/**
 * Turns: several optimization tools that want one server use it one after another.
 *
 * <p>A tool that asks for a server while another one has it is remembered. Between two episodes,
 * batches or requests of a tool whose turn is over, the server goes to the one that has waited
 * longest. Tools of the D6.1 profile have no name, and count as one tool. Since such a tool may ask
 * only once, its question is valid for longer, and is answered when its turn comes. Times are
 * nanoseconds of {@link System#nanoTime}.
 */
final class Turns {
  private static final long SECOND_NANOS = 1_000_000_000L;

  /** How long a tool has a server before another one that waits gets it. */
  private static final long TURN_NANOS = 5 * SECOND_NANOS;

  /** How long a question is valid: tools with a name repeat it every two seconds. */
  private static final long QUESTION_NANOS = 3 * SECOND_NANOS;

  /** How long that of an unnamed tool is valid, which may ask only once. */
  private static final long UNNAMED_QUESTION_NANOS = 30 * SECOND_NANOS;

  /** How long a server waits for the tool whose turn it is. */
  private static final long RESERVATION_NANOS = 3 * SECOND_NANOS;

  /** How long it waits for an unnamed one, at first and between two of its episodes. */
  static final long UNNAMED_RESERVATION_NANOS = SECOND_NANOS;

  /** Tools that are remembered. */
  private static final int MAX_WAITING = 256;

  /** The discovery of a tool that could not have the server. */
  private static final class Question {
    final Discovery discovery;
    final long askedAt;

    Question(Discovery discovery, long askedAt) {
      this.discovery = discovery;
      this.askedAt = askedAt;
    }

    boolean isOf(String tool) {
      return Objects.equals(discovery.getTool(), tool);
    }

    boolean isValid(long now) {
      return now - askedAt
          < (discovery.getTool() == null ? UNNAMED_QUESTION_NANOS : QUESTION_NANOS);
    }
  }

  /** The tool that has the server, empty for an unnamed one; null if none has it. */
  private Optional<String> holder;

  private long since;

  /** Whether the holder has not begun yet: waiting for it does not count as its turn. */
  private boolean reserved;

  /** The oldest first. */
  private final Deque<Question> waiting = new ArrayDeque<>();

  /** The hash of the discovery of the unnamed tool that was answered when its turn came. */
  private String invited;

  /** Remembers a tool that cannot have the server now. A tool that asks again keeps its place. */
  void ask(Discovery discovery, long now) {
    Question question = new Question(discovery, now);
    boolean isWaiting = waiting.stream().anyMatch(one -> one.isOf(discovery.getTool()));
    if (isWaiting) {
      Deque<Question> before = new ArrayDeque<>(waiting);
      waiting.clear();
      before.forEach(one -> waiting.add(one.isOf(discovery.getTool()) ? question : one));
    } else if (waiting.size() < MAX_WAITING) {
      waiting.add(question);
    }
  }

  /** Whether this tool has the server; null for an unnamed one. */
  boolean isHeldBy(String tool) {
    return holder != null && holder.equals(Optional.ofNullable(tool));
  }

  /**
   * Sets which tool has the server from now on.
   *
   * @param next empty for an unnamed tool; null for none, or one that is not known
   * @param active whether something is being computed
   */
  void heldBy(Optional<String> next, boolean active, long now) {
    if (Objects.equals(holder, next) && !(active && reserved)) {
      return;
    }
    since = now;
    reserved = !active;
    if (next != null) {
      removeQuestions(next.orElse(null));
    }
    if (next == null || next.isPresent()) {
      invited = null;
    }
    holder = next;
  }

  /** A tool has an answer; null for an unnamed one. */
  void removeQuestions(String tool) {
    waiting.removeIf(question -> question.isOf(tool));
  }

  /** An unnamed tool is answered, as its turn has come. */
  void invite(String hash) {
    invited = hash;
  }

  private boolean isOver(long now) {
    return now - since >= TURN_NANOS;
  }

  /** The discovery of the tool that waits longest, once the turn is over; null for none. */
  Discovery next(long now) {
    waiting.removeIf(question -> !question.isValid(now));
    if (!isOver(now) || waiting.isEmpty()) {
      return null;
    }
    return waiting.remove().discovery;
  }

  /** Whether the unnamed tool that has the server had to wait for it, and may go on. */
  boolean keepsUnnamed(long now) {
    return invited != null && !isOver(now);
  }

  /** How long the server waits for a tool whose turn it is; null for an unnamed one. */
  static long reservationNanos(String tool) {
    return tool == null ? UNNAMED_RESERVATION_NANOS : RESERVATION_NANOS;
  }

  /**
   * A tool configured another server.
   *
   * @return whether it is the one that this server is reserved for
   */
  boolean choseOther(String hash) {
    waiting.removeIf(
        question -> question.isOf(null) && hash.equals(question.discovery.getSimulationHash()));
    return reserved && hash.equals(invited);
  }
}
