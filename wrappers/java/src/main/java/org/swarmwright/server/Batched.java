package org.swarmwright.server;

import java.util.List;
import org.swarmwright.Simulation;
import org.swarmwright.extension.BatchActuators;
import org.swarmwright.extension.BatchStart;
import org.swarmwright.extension.Refusal;

/**
 * Batched evaluation: episodes that are stepped together, with a message for each step. Times are
 * nanoseconds of {@link System#nanoTime}.
 */
final class Batched {
  private final Identity identity;
  private final Offer offer;
  private final Occupancy occupancy;
  private final StepTimeout timeout;
  private final Replies replies;
  private final Outbox outbox;
  private final Warnings warnings;
  private final Unread unread;

  Batched(
      Identity identity,
      Offer offer,
      Occupancy occupancy,
      StepTimeout timeout,
      Replies replies,
      Outbox outbox,
      Warnings warnings,
      Unread unread) {
    this.identity = identity;
    this.offer = offer;
    this.occupancy = occupancy;
    this.timeout = timeout;
    this.replies = replies;
    this.outbox = outbox;
    this.warnings = warnings;
    this.unread = unread;
  }

  /**
   * Starts a batch.
   *
   * @throws Refusal if it cannot be served
   */
  void start(BatchStart start, long now) {
    replies.checkTitle(start.simulation);
    replies.checkMetrics(start.metrics);
    List<Simulation> simulations = offer.several(start.seeds.length);
    Batch batch = new Batch(start, identity.id, offer.description(), simulations, unread);
    occupancy.begin(batch, now);
    sense(now);
  }

  /**
   * Actuators of a step came in.
   *
   * @throws org.swarmwright.messages.MessageException if the batch does not wait for them
   */
  void actuate(BatchActuators message, long now) {
    Batch batch = occupancy.batch();
    if (batch == null) {
      return;
    }
    if (message.request != batch.start.request) {
      warnings.warnOnce(
          "refusing actuators for another batch than that of "
              + batch.start.tool
              + " that is under way");
    } else if (message.actuators.length == 0) {
      occupancy.finish(now);
    } else {
      batch.actuate(message);
      sense(now);
    }
  }

  private void sense(long now) {
    Batch batch = occupancy.batch();
    if (batch.stepSelfSteering(now)) {
      return;
    }
    try {
      replies.send(batch.start, batch.sense(now));
      if (batch.isOver()) {
        occupancy.finish(now);
      }
    } catch (Refusal refusal) {
      replies.send(batch.start, batch.refused(refusal));
      occupancy.finish(now);
    }
  }

  /** When {@link #tick} is needed; null for never. */
  Long nextTick() {
    Batch batch = occupancy.batch();
    if (batch == null) {
      return null;
    }
    return batch.isSelfSteering()
        ? batch.waitingSince
        : timeout.deadline(batch.waitingSince, batch.warned);
  }

  /** Time has passed. */
  void tick(long now) {
    Batch batch = occupancy.batch();
    if (batch == null) {
      return;
    }
    if (batch.isSelfSteering()) {
      sense(now);
    } else if (timeout.isOver(batch.waitingSince, now)) {
      String reason = batch.waitingFor(now);
      replies.send(batch.start, batch.refused(new Refusal(Refusal.Kind.FAILED, reason)));
      outbox.notice("warning: " + reason + "; the batch is given up, the server is free again");
      occupancy.free(now);
    } else if (!batch.warned && timeout.isWarningDue(batch.waitingSince, now)) {
      batch.warned = true;
      outbox.notice("warning: " + batch.waitingFor(now));
    }
  }
}
