package org.swarmwright.server;

import java.util.Objects;
import java.util.stream.Stream;
import org.swarmwright.extension.BatchActuators;
import org.swarmwright.extension.BatchStart;
import org.swarmwright.extension.Evaluate;
import org.swarmwright.extension.Refusal;
import org.swarmwright.extension.Request;
import org.swarmwright.extension.ToServer;
import org.swarmwright.messages.Discovery;
import org.swarmwright.messages.MessageException;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Presence;
import org.swarmwright.messages.Topics;
import org.swarmwright.messages.Topics.Topic;

/**
 * The decisions of a server, without I/O: messages and time go in, what is to be done goes to the
 * {@link Outbox}. Not thread-safe. Times are nanoseconds of {@link System#nanoTime}.
 */
final class Machine {
  private final Identity identity;
  private final Offer offer;
  private final Topics topics;
  private final Outbox outbox;
  private final Warnings warnings;
  private final DiscoveryReplies discoveryReplies;
  private final PresencePublisher presence;
  private final IdConflict idConflict;
  private final Occupancy occupancy;
  private final Replies replies;
  private final RunControl runControl;
  private final Stepwise stepwise;
  private final Batched batched;
  private final Offloaded offloaded;

  /**
   * Makes a free server.
   *
   * @param stepTimeout seconds that a step may wait for actuators
   */
  Machine(Identity identity, Offer offer, Topics topics, double stepTimeout, Outbox outbox) {
    this.identity = identity;
    this.offer = offer;
    this.topics = topics;
    this.outbox = outbox;
    StepTimeout timeout = new StepTimeout(stepTimeout);
    warnings = new Warnings(outbox);
    discoveryReplies = new DiscoveryReplies(identity, offer, outbox);
    presence = new PresencePublisher(identity, offer, outbox);
    idConflict = new IdConflict(identity, warnings);
    occupancy = new Occupancy(offer, discoveryReplies, presence);
    Unread unread = new Unread(outbox::notice);
    replies = new Replies(identity.id, offer, outbox, unread);
    stepwise = new Stepwise(occupancy, timeout, replies, outbox);
    runControl =
        new RunControl(
            identity, offer, occupancy, presence, stepwise, replies, outbox, warnings, unread);
    batched = new Batched(identity, offer, occupancy, timeout, replies, outbox, warnings, unread);
    offloaded = new Offloaded(occupancy, replies, outbox, warnings);
  }

  // Messages.

  /**
   * A message came in. Retained messages may be long out of date, and are ignored, except presence.
   */
  void receive(String name, byte[] payload, boolean retained, long now) {
    Topic topic = topics.parse(name);
    boolean cleared = topic == Topic.PRESENCE && payload.length == 0;
    if (topic == null
        || cleared
        || topic == Topic.TO_SERVER && !name.equals(topics.name(topic, identity.id))) {
      return;
    }
    if (retained && topic != Topic.PRESENCE) {
      warnings.warnOnce(
          "ignoring a retained message on "
              + topic.text()
              + ": in this protocol only presence is retained");
      return;
    }
    try {
      dispatch(topic, payload, now);
    } catch (TooLarge error) {
      warnings.warnOnce(error.getMessage());
    } catch (MessageException error) {
      if (topic == Topic.TO_SERVER) {
        replies.refuseUnread(payload, error.getMessage());
      }
      warnings.warnOnce("refusing a message on " + topic.text() + ": " + error.getMessage());
    }
  }

  private void dispatch(Topic topic, byte[] payload, long now) {
    switch (topic) {
      case DISCOVERY:
        discovery(Messages.readDiscovery(payload), now);
        break;
      case PARAMETERS:
        runControl.configure(Messages.readParameters(payload), now);
        break;
      case CONTROL:
        runControl.receive(Messages.readControl(payload), now);
        break;
      case ACTUATOR:
        stepwise.actuate(Messages.readActuator(payload), now);
        break;
      case PRESENCE:
        otherPresence(Messages.readPresence(payload), now);
        break;
      case TO_SERVER:
        if (Messages.isObject(payload)) {
          runControl.receive(Messages.readControl(payload), now);
        } else {
          extension(ToServer.read(payload), now);
        }
        break;
      default:
        break;
    }
  }

  private void discovery(Discovery discovery, long now) {
    if (discoveryReplies.fulfils(discovery) && occupancy.admits(discovery, now)) {
      discoveryReplies.send(discovery);
    }
  }

  /** A presence message came in that may be of another server with this one's ID. */
  private void otherPresence(Presence message, long now) {
    if (message.getServer() != identity.id) {
      return;
    }
    if (message.getState() == Presence.State.LOST) {
      // An old last will of this server, or that of another one, has replaced its presence.
      idConflict.lost(message);
      presence.forgetPublished();
      publishPresence(message.getSince());
    } else if (idConflict.isToLeave(message, now)) {
      presence.forgetPublished();
      presence.changedForLong(now);
    }
  }

  private void extension(ToServer message, long now) {
    if (message instanceof BatchActuators) {
      batched.actuate((BatchActuators) message, now);
      return;
    }
    Request request = (Request) message;
    if (!Replies.canReply(request.reply)) {
      warnings.warnOnce(
          "cannot answer a request: its \"reply\" is \""
              + request.reply
              + "\", which is not the topic of a tool");
      return;
    }
    try {
      serve(request, now);
    } catch (Refusal refusal) {
      if (refusal.kind() != Refusal.Kind.TAKEN) {
        warnings.warnOnce("refusing a request of " + request.tool + ": " + refusal.getMessage());
      }
      replies.refuse(request, refusal);
    }
  }

  private void serve(Request request, long now) {
    if (!identity.isMeant(request.instance)) {
      if (occupancy.is(Occupancy.State.FREE) && offer.offers(request.simulation)) {
        throw new Refusal(Refusal.Kind.TAKEN, "it is meant for another server with this id");
      }
      return;
    }
    String reason = reasonTaken(request);
    if (reason != null) {
      throw new Refusal(Refusal.Kind.TAKEN, reason);
    }
    if (request instanceof Evaluate) {
      offloaded.evaluate((Evaluate) request, now);
    } else {
      batched.start((BatchStart) request, now);
    }
  }

  /** Why the server cannot take a request now; null if it can. */
  private String reasonTaken(Request request) {
    String tool = request.tool;
    EvaluationQueue queue = occupancy.evaluations();
    Batch batch = occupancy.batch();
    if (queue != null && request instanceof Evaluate) {
      return queue.reasonTaken(tool);
    }
    if (queue != null) {
      return queue.tool() == null
          ? "stopping an evaluation that was given up"
          : "computing an evaluation for " + queue.tool();
    }
    if (batch != null && batch.start.tool.equals(tool)) {
      return "batch " + Long.toUnsignedString(batch.start.request) + " of this tool is under way";
    }
    return occupancy.isActive() || occupancy.isHeldForOther(tool)
        ? "taken by " + occupancy.holderInWords()
        : null;
  }

  /** A job has been computed. */
  void finished(Job job, long now) {
    offloaded.finished(job, now);
  }

  // Time and connection.

  /** The next time at which {@link #tick} is needed; null for none. */
  Long nextTick() {
    return Stream.of(
            occupancy.expiry(),
            stepwise.nextTick(),
            batched.nextTick(),
            runControl.nextTick(),
            presence.nextTick(),
            idConflict.nextTick())
        .filter(Objects::nonNull)
        .min(Long::compare)
        .orElse(null);
  }

  /**
   * What came in at {@code turn} has been computed and sent only now: no other party could act on
   * it before, however long the simulation took.
   */
  void computed(long turn, long now) {
    Run run = occupancy.run();
    Batch batch = occupancy.batch();
    if (run != null && run.waitingSince == turn) {
      run.waitingSince = now;
    } else if (batch != null && batch.waitingSince == turn && !batch.isSelfSteering()) {
      batch.waitingSince = now;
    } else {
      occupancy.computed(turn, now);
    }
  }

  /** Time has passed; {@code stamp} is now in RFC 3339, for presence. */
  void tick(long now, String stamp) {
    String rival = idConflict.rivalToLeaveFor(now);
    if (rival != null) {
      outbox.giveWay(rival);
      return;
    }
    runControl.tick(now);
    Long expiry = occupancy.expiry();
    if (expiry == null) {
      // At most one of the two has something to do.
      stepwise.tick(now);
      batched.tick(now);
    } else if (expiry <= now) {
      if (occupancy.is(Occupancy.State.CONFIGURED)) {
        outbox.notice(
            "warning: parameters arrived without a control message to start the run; free again");
      }
      occupancy.free(now);
    }
    Long due = presence.nextTick();
    if (due != null && due <= now) {
      publishPresence(stamp);
    }
  }

  /** The presence message for a state. */
  Presence presence(Presence.State state, String since) {
    return presence.message(state, occupancy.holder(), since);
  }

  /** Publishes what the server does now, unless the broker has it. */
  void publishPresence(String since) {
    Presence.State state =
        occupancy.is(Occupancy.State.FREE) ? Presence.State.READY : Presence.State.BUSY;
    presence.publish(state, occupancy.holder(), since);
  }

  /** Gives up what is under way; an evaluation, as soon as it can be stopped. */
  void free(long now) {
    occupancy.giveUp(now);
  }

  /** The connection broke: messages of the run are lost, so the run is. */
  void disconnected(String reason, long now) {
    if (occupancy.isActive()) {
      outbox.notice("warning: the run under way is given up with the connection");
    }
    outbox.notice("lost the broker: " + reason + "; trying again");
    runControl.disconnected();
    idConflict.disconnected();
    occupancy.giveUp(now);
    presence.disconnected();
  }

  /** The connection is there again, and no other server has the ID. */
  void connected(String stamp) {
    presence.connected();
    publishPresence(stamp);
  }
}
