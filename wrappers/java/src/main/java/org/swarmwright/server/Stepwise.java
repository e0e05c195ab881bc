package org.swarmwright.server;

import org.swarmwright.messages.Actuator;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Topics.Topic;

/**
 * Stepwise evaluation: an episode whose sensors and actuators are single messages. Times are
 * nanoseconds of {@link System#nanoTime}.
 */
final class Stepwise {
  private final Occupancy occupancy;
  private final StepTimeout timeout;
  private final Replies replies;
  private final Outbox outbox;

  Stepwise(Occupancy occupancy, StepTimeout timeout, Replies replies, Outbox outbox) {
    this.occupancy = occupancy;
    this.timeout = timeout;
    this.replies = replies;
    this.outbox = outbox;
  }

  /**
   * Actuators of an agent came in.
   *
   * @throws org.swarmwright.messages.MessageException if the episode does not wait for them
   */
  void actuate(Actuator actuator, long now) {
    Run run = occupancy.run();
    if (run == null || !run.hash.equals(actuator.getSimulationHash())) {
      return;
    }
    try {
      if (run.actuate(actuator)) {
        proceed(now);
      }
    } catch (Guard.EpisodeFailed failed) {
      fail(failed, now);
    }
  }

  /** A step begins: shows it if that is asked for, then sends the sensors, or the fitness. */
  void proceed(long now) {
    try {
      if (!show(now)) {
        sense(now);
      }
    } catch (Guard.EpisodeFailed failed) {
      fail(failed, now);
    }
  }

  /**
   * Sends the scene. Whether there was a picture to show; the episode goes on when it has been
   * seen.
   */
  private boolean show(long now) throws Guard.EpisodeFailed {
    Run run = occupancy.run();
    try {
      replies.scene(run);
    } catch (TooLarge error) {
      throw new Guard.EpisodeFailed(error.getMessage(), true);
    }
    String picture = run.picture();
    if (picture != null) {
      outbox.show(picture);
      run.resumeAt = now + run.pictureNanos();
    }
    return picture != null;
  }

  private void sense(long now) throws Guard.EpisodeFailed {
    try {
      makeStep(now);
    } catch (TooLarge error) {
      throw new Guard.EpisodeFailed(error.getMessage(), true);
    }
  }

  private void makeStep(long now) throws Guard.EpisodeFailed {
    Run run = occupancy.run();
    switch (run.sense(now, payload -> outbox.publish(Topic.SENSOR, payload))) {
      case STEP:
        // Messages that have come in are handled before the next step.
        run.resumeAt = now;
        show(now);
        break;
      case FITNESS:
        outbox.publish(Topic.FITNESS, Messages.write(run.fitness()));
        occupancy.finish(now);
        break;
      default:
        break;
    }
  }

  /** D6.1 has no message for a failed episode: tools that name no reply topic get no fitness. */
  private void fail(Guard.EpisodeFailed failed, long now) {
    Run run = occupancy.run();
    outbox.notice("warning: " + failed.getMessage());
    replies.failed(run.reply, run.hash, failed.getMessage(), failed.stack, failed.invalid);
    occupancy.finish(now);
  }

  /** When {@link #tick} is needed; null for never. */
  Long nextTick() {
    Run run = occupancy.run();
    if (run == null) {
      return null;
    }
    return run.resumeAt != 0 ? run.resumeAt : timeout.deadline(run.waitingSince, run.warned);
  }

  /** Time has passed. */
  void tick(long now) {
    Run run = occupancy.run();
    if (run == null) {
      return;
    }
    if (run.resumeAt != 0) {
      if (run.resumeAt <= now) {
        resume(run, now);
      }
    } else if (timeout.isOver(run.waitingSince, now)) {
      String reason = run.waitingFor(now);
      outbox.notice("warning: " + reason + "; the run is given up, the server is free again");
      replies.failed(run.reply, run.hash, reason, null, false);
      occupancy.free(now);
    } else if (!run.warned && timeout.isWarningDue(run.waitingSince, now)) {
      run.warned = true;
      outbox.notice("warning: " + run.waitingFor(now));
    }
  }

  private void resume(Run run, long now) {
    run.resumeAt = 0;
    try {
      sense(now);
    } catch (Guard.EpisodeFailed failed) {
      fail(failed, now);
    }
  }
}
