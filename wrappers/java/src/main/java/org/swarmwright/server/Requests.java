package org.swarmwright.server;

import org.swarmwright.extension.BatchActuators;
import org.swarmwright.extension.BatchStart;
import org.swarmwright.extension.Evaluate;
import org.swarmwright.extension.Refusal;
import org.swarmwright.extension.Request;
import org.swarmwright.extension.ToServer;
import org.swarmwright.messages.Discovery;

/** What a server decides of the requests of the extensions: offloaded evaluation and batches. */
abstract class Requests extends Occupancy {
  /** After how long a missing actuator is worth a word. */
  static final long TELL_AFTER = 5 * SECOND;

  /** How long a step may wait for actuators. */
  final long stepTimeout;

  final Replies replies;

  Requests(Identity identity, Offer offer, double stepTimeout, Outbox outbox) {
    super(identity, offer, outbox);
    this.stepTimeout = (long) (stepTimeout * SECOND);
    replies = new Replies(identity.id, offer, outbox);
  }

  void request(ToServer message, long now) {
    if (message instanceof BatchActuators) {
      stepBatch((BatchActuators) message, now);
      return;
    }
    Request request = (Request) message;
    if (!Replies.canReply(request.reply)) {
      complain(
          "cannot answer a request: its \"reply\" is \""
              + request.reply
              + "\", which is no topic of a tool");
      return;
    }
    try {
      if (!identity.isMeant(request.instance)) {
        if (state == State.FREE && offer.description().title().equals(request.simulation)) {
          throw new Refusal(Refusal.Kind.TAKEN, "it is meant for another server with this id");
        }
        return;
      }
      checkTaken(request);
      if (request instanceof Evaluate) {
        evaluate((Evaluate) request, now);
      } else {
        startBatch((BatchStart) request, now);
      }
    } catch (Refusal refusal) {
      if (refusal.kind() != Refusal.Kind.TAKEN) {
        complain("refusing a request of " + request.tool + ": " + refusal.getMessage());
      }
      replies.refuse(request, refusal);
    }
  }

  private void checkTaken(Request request) {
    String tool = request.tool;
    String reason = null;
    if (state == State.WORKING && request instanceof Evaluate) {
      reason = work.taken(tool);
    } else if (state == State.WORKING) {
      reason =
          work.holder() == null
              ? "stopping an evaluation that was given up"
              : "computing an evaluation for " + work.holder();
    } else if (state == State.STEPPING && batch.start.tool.equals(tool)) {
      reason = "batch " + Long.toUnsignedString(batch.start.request) + " of this tool is under way";
    } else if (state == State.RUNNING
        || state == State.STEPPING
        || state == State.HELD && !tool.equals(holder)) {
      reason = "taken by " + holderInWords();
    }
    if (reason != null) {
      throw new Refusal(Refusal.Kind.TAKEN, reason);
    }
  }

  private void evaluate(Evaluate request, long now) {
    Job job = replies.job(request, now);
    if (state == State.WORKING) {
      boolean follows = work.holder() == null;
      if (follows && changedAt == null) {
        changedAt = now;
      }
      work.add(request.tool, job);
      if (follows) {
        hasBegun(now);
      }
      return;
    }
    begin(new Work(request.tool, job), now);
    outbox.evaluate(job);
  }

  /** A job has been computed; the next one follows. */
  void finished(Job job, long now) {
    if (state != State.WORKING) {
      return;
    }
    if (work.holder() == null) {
      enter(State.FREE, now);
      return;
    }
    if (!work.wasGivenUp()) {
      if (job.error != null) {
        complain("refusing an evaluation for " + work.holder() + ": " + job.error.getMessage());
      }
      replies.send(job);
    }
    if (turnEnds(now)) {
      return;
    }
    for (Job next = work.next(); next != null; next = work.next()) {
      if (next.expires == null || next.expires > now) {
        outbox.evaluate(next);
        return;
      }
      replies.refuse(
          next.request, new Refusal(Refusal.Kind.FAILED, "the lease ran out before its turn came"));
    }
    leave(now);
  }

  /** Answers the requests that wait when it is another tool's turn. Whether it is. */
  private boolean turnEnds(long now) {
    Discovery next = turns.next(now);
    if (next == null) {
      return false;
    }
    String tool = next.getTool();
    String reason =
        "it is the turn of " + (tool == null ? "an optimization tool without a name" : tool);
    for (Job waiting = work.next(); waiting != null; waiting = work.next()) {
      replies.refuse(waiting.request, new Refusal(Refusal.Kind.TAKEN, reason));
    }
    handOver(next, now);
    return true;
  }

  private void startBatch(BatchStart start, long now) {
    replies.checkTitle(start.simulation);
    replies.checkMetrics(start.metrics);
    Batch started =
        new Batch(start, identity.id, offer.description(), offer.several(start.seeds.length));
    begin(started, now);
    senseBatch(now);
  }

  private void stepBatch(BatchActuators message, long now) {
    if (state != State.STEPPING) {
      return;
    }
    if (message.request != batch.start.request) {
      complain(
          "refusing actuators of another batch than that of "
              + batch.start.tool
              + " that is under way");
    } else if (message.actuators.length == 0) {
      leave(now);
    } else {
      batch.actuate(message);
      senseBatch(now);
    }
  }

  private void senseBatch(long now) {
    if (batch.goOn(now)) {
      return;
    }
    try {
      replies.send(batch.start, batch.sense(now));
      if (batch.isOver()) {
        leave(now);
      }
    } catch (Refusal refusal) {
      replies.send(batch.start, batch.refused(refusal));
      leave(now);
    }
  }

  /** Time has passed for a batch. */
  void tickBatch(long now) {
    if (batch.goesOn) {
      senseBatch(now);
      return;
    }
    String words = batch.waitingFor(now);
    if (now - batch.waitingSince >= stepTimeout) {
      replies.send(batch.start, batch.refused(new Refusal(Refusal.Kind.FAILED, words)));
      outbox.notice("warning: " + words + "; the batch is given up, the server is free again");
      enter(State.FREE, now);
    } else if (!batch.told && now - batch.waitingSince >= TELL_AFTER) {
      batch.told = true;
      outbox.notice("warning: " + words);
    }
  }
}
