package org.swarmwright.server;

import com.google.gson.JsonObject;
import java.util.HashSet;
import java.util.LinkedHashMap;
import java.util.List;
import java.util.Map;
import java.util.Objects;
import java.util.Set;
import org.swarmwright.extension.BatchActuators;
import org.swarmwright.extension.BatchStart;
import org.swarmwright.extension.Evaluate;
import org.swarmwright.extension.Refusal;
import org.swarmwright.extension.Request;
import org.swarmwright.extension.ToServer;
import org.swarmwright.messages.Actuator;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Control;
import org.swarmwright.messages.Discovery;
import org.swarmwright.messages.MessageException;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Parameters;
import org.swarmwright.messages.Presence;
import org.swarmwright.messages.Requirements;
import org.swarmwright.messages.Server;
import org.swarmwright.messages.Swarmwright;
import org.swarmwright.messages.Topics;
import org.swarmwright.messages.Topics.Topic;

/**
 * What a server decides: messages and time in, what is to be done out, no I/O, one thread at a
 * time.
 *
 * <p>A server is free, configured (parameters came, it waits for control), running an episode,
 * stepping a batch, working on requests for offloaded evaluation, or held: between two episodes of
 * a tool that gave its name it stays reserved for that tool for a moment (docs/decisions/004).
 * Times are nanoseconds of {@link System#nanoTime}.
 */
final class Machine {
  private static final long SECOND = 1_000_000_000L;

  /**
   * How long parameters without control, or a holder without a new episode, keep the server taken.
   */
  private static final long PATIENCE = 5 * SECOND;

  /** After how long a missing actuator is worth a word. */
  private static final long TELL_AFTER = 5 * SECOND;

  /**
   * A change of presence is published when it has lasted this long: runs of a few milliseconds are
   * no news.
   */
  private static final long SETTLE = 150_000_000L;

  private static final int KEPT = 8;
  private static final int MOST_COMPLAINTS = 1000;

  private enum State {
    FREE,
    CONFIGURED,
    RUNNING,
    STEPPING,
    WORKING,
    HELD
  }

  private final Identity identity;
  private final Offer offer;
  private final Topics topics;
  private final long stepTimeout;
  private final Outbox outbox;
  private final Offloaded offloaded;

  private State state = State.FREE;
  private long until;
  private Run run;
  private Batch batch;
  private Work work;
  private String holder;

  /** The last parameters by hash, the newest at the end. */
  private final Map<String, JsonObject> parameters = new LinkedHashMap<>();

  /** The hash of the run before, which a control{run: false} may still name. */
  private String lastHash;

  private String newestHash;
  private final Set<String> complaints = new HashSet<>();
  private Presence.State published;
  private String publishedHolder;
  private Long changedAt;

  Machine(Identity identity, Offer offer, Topics topics, double stepTimeout, Outbox outbox) {
    this.identity = identity;
    this.offer = offer;
    this.topics = topics;
    this.stepTimeout = (long) (stepTimeout * SECOND);
    this.outbox = outbox;
    offloaded = new Offloaded(identity.id, offer, outbox);
  }

  /** A message came in. Retained messages are leftovers of somebody's past, except presence. */
  void receive(String name, byte[] payload, boolean retained, long now) {
    Topic topic = topics.parse(name);
    boolean empty = topic == Topic.PRESENCE && payload.length == 0;
    if (topic == null
        || empty
        || topic == Topic.TO_SERVER && !name.equals(topics.name(topic, identity.id))) {
      return;
    }
    if (retained && topic != Topic.PRESENCE) {
      complain(
          "ignoring a retained message on "
              + topic.text()
              + ": nothing in this protocol is to be retained");
      return;
    }
    try {
      dispatch(topic, payload, now);
    } catch (MessageException error) {
      if (topic == Topic.TO_SERVER) {
        offloaded.refuseUnread(payload, error.getMessage());
      }
      complain("refusing a message on " + topic.text() + ": " + error.getMessage());
    }
  }

  private void dispatch(Topic topic, byte[] payload, long now) {
    switch (topic) {
      case DISCOVERY:
        discovery(Messages.readDiscovery(payload));
        break;
      case PARAMETERS:
        configure(Messages.readParameters(payload), now);
        break;
      case CONTROL:
        control(Messages.readControl(payload), now);
        break;
      case ACTUATOR:
        actuate(Messages.readActuator(payload), now);
        break;
      case PRESENCE:
        otherPresence(Messages.readPresence(payload));
        break;
      case TO_SERVER:
        request(ToServer.read(payload), now);
        break;
      default:
        break;
    }
  }

  // Discovery, parameters, control.

  private void discovery(Discovery discovery) {
    boolean free = state == State.FREE || state == State.HELD && holder.equals(discovery.getTool());
    if (!free || !offer.description().title().equals(discovery.getSimulation())) {
      return;
    }
    Capabilities capabilities = capabilities();
    Requirements required = discovery.getRequirements();
    boolean enough =
        capabilities.getMaxAgents() == null
            || required.getMaxAgents() == null
            || capabilities.getMaxAgents() >= required.getMaxAgents();
    if (enough && required.getDimensions().equals(capabilities.getDimensions())) {
      Server answer =
          new Server()
              .withServer(identity.id)
              .withSimulationHash(discovery.getSimulationHash())
              .withSimulations(titles())
              .withCapabilities(capabilities);
      outbox.publish(Topic.SERVER, Messages.write(answer));
    }
  }

  private void configure(Parameters message, long now) {
    if (message.getServer() != identity.id) {
      return;
    }
    newestHash = message.getSimulationHash();
    parameters.remove(newestHash);
    parameters.put(newestHash, Messages.problem(message));
    if (parameters.size() > KEPT) {
      parameters.remove(parameters.keySet().iterator().next());
    }
    if (state == State.FREE || state == State.CONFIGURED) {
      enter(State.CONFIGURED, now);
      until = now + PATIENCE;
    }
  }

  private void control(Control control, long now) {
    if (control.getServer() != identity.id) {
      return;
    }
    if (!control.getRun()) {
      end(control, now);
      return;
    }
    String asker =
        control.getTool() == null ? "an optimization tool without a name" : control.getTool();
    if (state == State.RUNNING && run.hash.equals(control.getSimulationHash())) {
      complain("ignoring a control message that starts a run that is under way");
      return;
    }
    boolean held = state == State.HELD && !holder.equals(control.getTool());
    if (held || state == State.RUNNING || state == State.STEPPING || state == State.WORKING) {
      complain("refusing to start a run for " + asker + ": taken by " + holderInWords());
      return;
    }
    JsonObject values = parameters.get(control.getSimulationHash());
    if (values == null) {
      complain("refusing to start a run for " + asker + ": no parameters came for its hash");
      return;
    }
    try {
      Run started =
          new Run(
              offer.first(),
              values,
              control.getSimulationHash(),
              control.getTool(),
              control.getVisual());
      enter(State.RUNNING, now);
      run = started;
      proceed(now);
    } catch (Guard.Broken | IllegalArgumentException error) {
      outbox.notice("warning: cannot start the run: " + error.getMessage());
      enter(State.FREE, now);
    }
  }

  private void end(Control control, long now) {
    String hash = control.getSimulationHash();
    boolean ours = false;
    switch (state) {
      case FREE:
        return;
      case RUNNING:
        ours = run.hash.equals(hash);
        break;
      case CONFIGURED:
        ours = hash.equals(newestHash);
        break;
      case HELD:
        ours = hash.equals(lastHash) || holder.equals(control.getTool());
        break;
      default:
        ours = control.getTool() != null && control.getTool().equals(holder());
        break;
    }
    if (ours) {
      free(now);
    } else {
      complain("ignoring the end of a run that is not under way");
    }
  }

  // Stepwise.

  private void actuate(Actuator actuator, long now) {
    if (state != State.RUNNING || !run.hash.equals(actuator.getSimulationHash())) {
      return;
    }
    try {
      if (run.actuate(actuator)) {
        proceed(now);
      }
    } catch (Guard.Broken broken) {
      fail(broken, now);
    }
  }

  /** A step begins: shows it where that is wanted, then sends the sensors, or the fitness. */
  private void proceed(long now) {
    try {
      if (!show(now)) {
        sense(now);
      }
    } catch (Guard.Broken broken) {
      fail(broken, now);
    }
  }

  /** Whether there is a picture to show, at the pace of people. */
  private boolean show(long now) throws Guard.Broken {
    String picture = run.picture();
    if (picture != null) {
      outbox.show(picture);
      run.resumeAt = now + run.pictureNanos();
    }
    return picture != null;
  }

  private void sense(long now) throws Guard.Broken {
    switch (run.sense(now, payload -> outbox.publish(Topic.SENSOR, payload))) {
      case STEP:
        // In between, the server looks at its messages.
        run.resumeAt = now;
        show(now);
        break;
      case FITNESS:
        outbox.publish(Topic.FITNESS, Messages.write(run.fitness()));
        leave(now);
        break;
      default:
        break;
    }
  }

  /** D6.1 has no message for it: the tool misses the fitness, the operator reads why. */
  private void fail(Guard.Broken broken, long now) {
    outbox.notice("warning: " + broken.getMessage());
    leave(now);
  }

  // Requests of the extensions.

  private void request(ToServer message, long now) {
    if (message instanceof BatchActuators) {
      stepBatch((BatchActuators) message, now);
      return;
    }
    Request request = (Request) message;
    if (!Offloaded.canReply(request.reply)) {
      complain(
          "cannot answer a request: its \"reply\" is \""
              + request.reply
              + "\", which is no topic of a tool");
      return;
    }
    try {
      checkTaken(request.tool);
      if (request instanceof Evaluate) {
        evaluate((Evaluate) request, now);
      } else {
        startBatch((BatchStart) request, now);
      }
    } catch (Refusal refusal) {
      if (refusal.kind() != Refusal.Kind.TAKEN) {
        complain("refusing a request of " + request.tool + ": " + refusal.getMessage());
      }
      offloaded.refuse(request, refusal);
    }
  }

  private void checkTaken(String tool) {
    String reason = null;
    if (state == State.WORKING) {
      reason = work.taken(tool);
    } else if (state == State.STEPPING && batch.start.tool.equals(tool)) {
      reason = "batch " + Long.toUnsignedString(batch.start.request) + " of this tool is under way";
    } else if (state == State.RUNNING
        || state == State.STEPPING
        || state == State.HELD && !holder.equals(tool)) {
      reason = "taken by " + holderInWords();
    }
    if (reason != null) {
      throw new Refusal(Refusal.Kind.TAKEN, reason);
    }
  }

  private void evaluate(Evaluate request, long now) {
    Job job = offloaded.job(request, now);
    if (state == State.WORKING) {
      work.add(job);
      return;
    }
    enter(State.WORKING, now);
    work = new Work(request.tool, job);
    outbox.evaluate(job);
  }

  /** A job has been computed; the next one follows. */
  void finished(Job job, long now) {
    if (state != State.WORKING) {
      return;
    }
    if (work.isReleased()) {
      enter(State.FREE, now);
      return;
    }
    if (job.error != null) {
      complain("refusing an evaluation for " + work.tool + ": " + job.error.getMessage());
    }
    offloaded.send(job);
    for (Job next = work.next(); next != null; next = work.next()) {
      if (next.expires == null || next.expires > now) {
        outbox.evaluate(next);
        return;
      }
      offloaded.refuse(
          next.request, new Refusal(Refusal.Kind.FAILED, "the lease ran out before its turn came"));
    }
    leave(now);
  }

  private void startBatch(BatchStart start, long now) {
    offloaded.checkTitle(start.simulation);
    offloaded.checkMetrics(start.metrics);
    Batch started =
        new Batch(start, identity.id, offer.description(), offer.several(start.seeds.length));
    enter(State.STEPPING, now);
    batch = started;
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
      offloaded.send(batch.start, batch.sense(now));
      if (batch.isOver()) {
        leave(now);
      }
    } catch (Refusal refusal) {
      offloaded.send(batch.start, batch.refused(refusal));
      leave(now);
    }
  }

  // Time, connection, state.

  /** The next time at which {@link #tick} is needed; null for none. */
  Long nextTick() {
    Long own = null;
    if (state == State.CONFIGURED || state == State.HELD) {
      own = until;
    } else if (state == State.RUNNING) {
      own = run.resumeAt != 0 ? run.resumeAt : deadline(run.waitingSince, run.told);
    } else if (state == State.STEPPING) {
      own =
          batch.goesOn
              ? (Long) batch.waitingSince
              : (Long) deadline(batch.waitingSince, batch.told);
    }
    Long settled = changedAt == null ? null : changedAt + SETTLE;
    return own == null ? settled : settled == null ? own : (Long) Math.min(own, settled);
  }

  /** When somebody is told that actuators are missing, or the run is given up. */
  private long deadline(long since, boolean told) {
    return since + (told ? stepTimeout : Math.min(TELL_AFTER, stepTimeout));
  }

  /** Time has passed; {@code stamp} is now in RFC 3339, for presence. */
  void tick(long now, String stamp) {
    if (state == State.CONFIGURED && until <= now) {
      outbox.notice(
          "warning: parameters came, but no control message to start the run; free again");
      enter(State.FREE, now);
    } else if (state == State.HELD && until <= now) {
      enter(State.FREE, now);
    } else if (state == State.RUNNING) {
      tickRun(now);
    } else if (state == State.STEPPING) {
      tickBatch(now);
    }
    if (changedAt != null && changedAt + SETTLE <= now) {
      publishPresence(stamp);
    }
  }

  private void tickRun(long now) {
    if (run.resumeAt != 0) {
      if (run.resumeAt <= now) {
        run.resumeAt = 0;
        try {
          sense(now);
        } catch (Guard.Broken broken) {
          fail(broken, now);
        }
      }
    } else if (now - run.waitingSince >= stepTimeout) {
      outbox.notice(
          "warning: " + run.waitingFor(now) + "; the run is given up, the server is free again");
      enter(State.FREE, now);
    } else if (!run.told && now - run.waitingSince >= TELL_AFTER) {
      run.told = true;
      outbox.notice("warning: " + run.waitingFor(now));
    }
  }

  private void tickBatch(long now) {
    if (batch.goesOn) {
      senseBatch(now);
      return;
    }
    String words = batch.waitingFor(now);
    if (now - batch.waitingSince >= stepTimeout) {
      offloaded.send(batch.start, batch.refused(new Refusal(Refusal.Kind.FAILED, words)));
      outbox.notice("warning: " + words + "; the batch is given up, the server is free again");
      enter(State.FREE, now);
    } else if (!batch.told && now - batch.waitingSince >= TELL_AFTER) {
      batch.told = true;
      outbox.notice("warning: " + words);
    }
  }

  /** The connection broke: messages of the run are lost, so the run is. */
  void disconnected(String reason, long now) {
    if (state == State.RUNNING || state == State.STEPPING || state == State.WORKING) {
      outbox.notice("warning: the run under way is given up with the connection");
    }
    outbox.notice("lost the broker: " + reason + "; trying again");
    free(now);
    published = null;
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
  private void leave(long now) {
    String tool = holder();
    enter(tool == null ? State.FREE : State.HELD, now);
    holder = tool;
    until = now + PATIENCE;
  }

  private void enter(State next, long now) {
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

  // What the server says of itself.

  private String holder() {
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

  private String holderInWords() {
    return holder() == null ? "another optimization tool" : holder();
  }

  List<String> titles() {
    return List.of(offer.description().title());
  }

  private Capabilities capabilities() {
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

  private void otherPresence(Presence presence) {
    Swarmwright other = presence.getCapabilities().getSwarmwright();
    if (presence.getServer() != identity.id
        || other != null && identity.instance.equals(other.getInstance())) {
      if (presence.getState() != Presence.State.LOST || presence.getServer() != identity.id) {
        return;
      }
    }
    if (presence.getState() == Presence.State.LOST) {
      // A last will, an old one of this server or that of another with its ID, stands in the place
      // of what is true.
      published = null;
      publishPresence(presence.getSince());
    } else {
      String host = other == null || other.getHost() == null ? "an unknown host" : other.getHost();
      complain(
          "another server has the id "
              + identity.id
              + " too ("
              + host
              + "); give one of them another --id");
    }
  }

  /** A warning that is made only once, however often its cause comes back. */
  private void complain(String text) {
    if (complaints.size() < MOST_COMPLAINTS && complaints.add(text)) {
      outbox.notice("warning: " + text);
    }
  }
}
