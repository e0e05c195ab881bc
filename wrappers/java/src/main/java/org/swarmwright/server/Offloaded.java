package org.swarmwright.server;

import org.swarmwright.extension.Evaluate;
import org.swarmwright.extension.Refusal;
import org.swarmwright.messages.Discovery;

/**
 * Offloaded evaluation: the controllers are computed in this process. Times are nanoseconds of
 * {@link System#nanoTime}.
 */
final class Offloaded {
  private final Occupancy occupancy;
  private final Replies replies;
  private final Outbox outbox;
  private final Warnings warnings;

  Offloaded(Occupancy occupancy, Replies replies, Outbox outbox, Warnings warnings) {
    this.occupancy = occupancy;
    this.replies = replies;
    this.outbox = outbox;
    this.warnings = warnings;
  }

  /**
   * Computes a request, or queues it behind the others of its tool.
   *
   * @throws Refusal if it cannot be served
   */
  void evaluate(Evaluate request, long now) {
    Job job = replies.job(request, now);
    EvaluationQueue queue = occupancy.evaluations();
    if (queue == null) {
      occupancy.begin(new EvaluationQueue(request.tool, job), now);
      outbox.evaluate(job);
      return;
    }
    boolean takesOver = queue.tool() == null;
    queue.add(request.tool, job);
    if (takesOver) {
      occupancy.queueTakenOver(now);
    }
  }

  /** A job has been computed; the next one follows. */
  void finished(Job job, long now) {
    EvaluationQueue queue = occupancy.evaluations();
    if (queue == null) {
      return;
    }
    String tool = queue.tool();
    if (tool == null) {
      occupancy.free(now);
      return;
    }
    if (!queue.takeGivenUp()) {
      if (job.error != null) {
        warnings.warnOnce("refusing an evaluation for " + tool + ": " + job.error.getMessage());
      }
      replies.send(job);
    }
    Discovery next = occupancy.nextTurn(now);
    if (next == null) {
      computeNext(queue, now);
    } else {
      refuseWaiting(queue, next.getTool());
      occupancy.handOver(next, now);
    }
  }

  private void computeNext(EvaluationQueue queue, long now) {
    for (Job next = queue.next(); next != null; next = queue.next()) {
      if (next.expires == null || next.expires > now) {
        outbox.evaluate(next);
        return;
      }
      replies.refuse(
          next.request, new Refusal(Refusal.Kind.FAILED, "the lease ran out before its turn came"));
    }
    occupancy.finish(now);
  }

  /** Answers the requests that wait when it is another tool's turn. */
  private void refuseWaiting(EvaluationQueue queue, String tool) {
    String reason =
        "it is the turn of " + (tool == null ? "an optimization tool without a name" : tool);
    for (Job waiting = queue.next(); waiting != null; waiting = queue.next()) {
      replies.refuse(waiting.request, new Refusal(Refusal.Kind.TAKEN, reason));
    }
  }
}
