package org.swarmwright.server;

import com.google.gson.JsonObject;
import java.util.LinkedHashMap;
import java.util.LinkedHashSet;
import java.util.Map;
import java.util.Objects;
import java.util.Set;
import org.swarmwright.extension.ToServer;
import org.swarmwright.messages.Actuator;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Control;
import org.swarmwright.messages.Discovery;
import org.swarmwright.messages.MessageException;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Parameters;
import org.swarmwright.messages.Requirements;
import org.swarmwright.messages.Topics;
import org.swarmwright.messages.Topics.Topic;

/**
 * What a server decides: messages and time in, what is to be done out, no I/O, one thread at a
 * time. Times are nanoseconds of {@link System#nanoTime}.
 */
final class Machine extends Requests {
  /** Parameters messages kept for a control to come: of the tools on a broker, few ask at once. */
  private static final int KEPT = 8;

  /** Characters of a foreign title that are quoted, at most. */
  private static final int MOST_TITLE = 200;

  /** Hashes of runs that are remembered, so that each begins once. */
  private static final int BEGUN = 64;

  private final Topics topics;

  /** The last parameters by hash, the newest at the end. */
  private final Map<String, JsonObject> parameters = new LinkedHashMap<>();

  private final Early early = new Early();

  private String newestHash;

  /** The last runs of tools that say where to reply, which give every run a hash of its own. */
  private final Set<String> begun = new LinkedHashSet<>();

  /** The connection is broken: what would be published now is lost. */
  private boolean offline;

  Machine(Identity identity, Offer offer, Topics topics, double stepTimeout, Outbox outbox) {
    super(identity, offer, stepTimeout, outbox);
    this.topics = topics;
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
    } catch (TooLarge error) {
      complain(error.getMessage());
    } catch (MessageException error) {
      if (topic == Topic.TO_SERVER) {
        replies.refuseUnread(payload, error.getMessage());
      }
      complain("refusing a message on " + topic.text() + ": " + error.getMessage());
    }
  }

  private void dispatch(Topic topic, byte[] payload, long now) {
    switch (topic) {
      case DISCOVERY:
        discovery(Messages.readDiscovery(payload), now);
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
        otherPresence(Messages.readPresence(payload), now);
        break;
      case TO_SERVER:
        request(ToServer.read(payload), now);
        break;
      default:
        break;
    }
  }

  // Discovery, parameters, control.

  private void discovery(Discovery discovery, long now) {
    if (!offer.description().title().equals(discovery.getSimulation())) {
      return;
    }
    Capabilities capabilities = capabilities();
    Requirements required = discovery.getRequirements();
    boolean enough =
        capabilities.getMaxAgents() == null
            || required.getMaxAgents() == null
            || capabilities.getMaxAgents() >= required.getMaxAgents();
    if (!enough
        || !required.getDimensions().equals(capabilities.getDimensions())
        || !isFreeFor(discovery, now)) {
      return;
    }
    if (discovery.getTool() == null) {
      turns.hasAskedEnough(null);
    }
    answer(discovery);
  }

  /** Whether a tool may have the server. One that may not is remembered, and has its turn later. */
  private boolean isFreeFor(Discovery discovery, long now) {
    String tool = discovery.getTool();
    if (state == State.FREE || state == State.HELD && Objects.equals(holder, tool)) {
      return true;
    }
    if (!turns.isHeldBy(tool)) {
      turns.ask(discovery, now);
    }
    return false;
  }

  private void configure(Parameters message, long now) {
    if (message.getServer() != identity.id) {
      otherConfigured(message.getSimulationHash(), now);
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
    } else if (state == State.HELD && holder == null) {
      // Nobody says whose they are: those of the tool that is waited for, as far as anybody knows.
      until = now + PATIENCE;
    }
    Control waiting = early.take(newestHash);
    if (waiting != null) {
      control(waiting, now);
    }
  }

  /** Where it is the tool without a name that this server waits for, it need not. */
  private void otherConfigured(String hash, long now) {
    boolean free = turns.hasChosenAnother(hash) && state == State.HELD && holder == null;
    if (free) {
      enter(State.FREE, now);
      tellAtOnce(now);
    }
  }

  private void control(Control control, long now) {
    if (control.getServer() != identity.id) {
      return;
    }
    if (!identity.isMeant(control.getInstance())) {
      // Where that one is gone, its tool hears of this one.
      if (control.getRun() && state == State.FREE && offers(control.getSimulation())) {
        complain(refusing(control) + "it is meant for another server with this id");
        tellAgain(now);
      }
      return;
    }
    if (!control.getRun()) {
      end(control, now);
      return;
    }
    if (state == State.RUNNING && run.hash.equals(control.getSimulationHash())) {
      complain("ignoring a control message that starts a run that is under way");
      return;
    }
    boolean held = state == State.HELD && !Objects.equals(holder, control.getTool());
    if (held || state == State.RUNNING || state == State.STEPPING || state == State.WORKING) {
      complain(refusing(control) + "taken by " + holderInWords());
      tellAgain(now);
      return;
    }
    if (!offers(control.getSimulation())) {
      refuseTitle(control);
      return;
    }
    boolean once = control.getReply() != null;
    if (once && begun.contains(control.getSimulationHash())) {
      // The message came twice: the tool, which may not know yet that the run is over, would go on
      // with it.
      complain("ignoring a control message that starts a run a second time");
      return;
    }
    JsonObject values = parameters.get(control.getSimulationHash());
    if (values == null) {
      early.keep(control, now);
      return;
    }
    if (once) {
      begun.add(control.getSimulationHash());
      if (begun.size() > BEGUN) {
        begun.remove(begun.iterator().next());
      }
    }
    try {
      begin(new Run(offer.first(), values, control), now);
      proceed(now);
    } catch (Guard.Broken broken) {
      cannotStart(control, broken.getMessage(), broken.stack, broken.invalid, now);
    } catch (IllegalArgumentException error) {
      cannotStart(control, String.valueOf(error.getMessage()), null, true, now);
    }
  }

  /** Whether a simulation is offered; a tool that names none means the only one. */
  private boolean offers(String title) {
    return title == null || offer.description().title().equals(title);
  }

  /** A tool wants an episode of what is not offered here: it takes this server for another one. */
  private void refuseTitle(Control control) {
    String title = control.getSimulation();
    String reason =
        "simulation: \""
            + title.substring(0, Math.min(title.length(), MOST_TITLE))
            + "\" is not offered here, only "
            + offer.description().title();
    complain(refusing(control) + reason);
    replies.failed(control.getReply(), control.getSimulationHash(), reason, null, true);
  }

  private static String refusing(Control control) {
    return "refusing to start a run for " + asker(control) + ": ";
  }

  private static String asker(Control control) {
    return control.getTool() == null ? "an optimization tool without a name" : control.getTool();
  }

  private void cannotStart(
      Control control, String reason, String stack, boolean invalid, long now) {
    outbox.notice("warning: cannot start the run: " + reason);
    replies.failed(control.getReply(), control.getSimulationHash(), reason, stack, invalid);
    if (control.getTool() == null) {
      enter(State.FREE, now);
    } else {
      hold(control.getTool(), now + PATIENCE, now);
    }
  }

  private void end(Control control, long now) {
    String hash = control.getSimulationHash();
    early.forget(control);
    boolean ours = false;
    switch (state) {
      case FREE:
        return;
      case RUNNING:
        ours = run.hash.equals(hash) && Objects.equals(run.tool, control.getTool());
        break;
      case CONFIGURED:
        ours = hash.equals(newestHash);
        break;
      case HELD:
        ours =
            holder == null
                ? control.getTool() == null
                    && (hash.equals(lastHash) || parameters.containsKey(hash))
                : holder.equals(control.getTool());
        break;
      default:
        ours = control.getTool() != null && control.getTool().equals(holder());
        break;
    }
    if (ours) {
      boolean held = state == State.HELD;
      free(now);
      if (held) {
        tellAtOnce(now);
      }
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

  /** Makes a step, which breaks the run where the broker does not take what it sends. */
  private void sense(long now) throws Guard.Broken {
    try {
      makeStep(now);
    } catch (TooLarge error) {
      throw new Guard.Broken(error.getMessage(), true);
    }
  }

  private void makeStep(long now) throws Guard.Broken {
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

  /** D6.1 has no message for it: a tool that does not say where to report it misses the fitness. */
  private void fail(Guard.Broken broken, long now) {
    outbox.notice("warning: " + broken.getMessage());
    replies.failed(run.reply, run.hash, broken.getMessage(), broken.stack, broken.invalid);
    leave(now);
  }

  // Time and connection.

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
    Long settled = changedAt == null || offline ? null : (Long) (changedAt + SETTLE);
    Long leaves = leavingTo == null ? null : (Long) leavingAt;
    return earlier(leaves, earlier(early.next(), earlier(own, settled)));
  }

  private static Long earlier(Long one, Long other) {
    return one == null ? other : other == null ? one : (Long) Math.min(one, other);
  }

  /** When somebody is told that actuators are missing, or the run is given up. */
  private long deadline(long since, boolean told) {
    return since + (told ? stepTimeout : Math.min(TELL_AFTER, stepTimeout));
  }

  /** Time has passed; {@code stamp} is now in RFC 3339, for presence. */
  void tick(long now, String stamp) {
    if (leavingTo != null && leavingAt <= now) {
      outbox.giveWay(leavingTo);
      return;
    }
    for (Control late : early.late(now)) {
      complain(
          refusing(late)
              + "no parameters came for its hash, "
              + Early.OVERTAKEN / SECOND
              + " s after its control message");
    }
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
    if (!offline && changedAt != null && changedAt + SETTLE <= now) {
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
      String words = run.waitingFor(now);
      outbox.notice("warning: " + words + "; the run is given up, the server is free again");
      replies.failed(run.reply, run.hash, words, null, false);
      enter(State.FREE, now);
    } else if (!run.told && now - run.waitingSince >= TELL_AFTER) {
      run.told = true;
      outbox.notice("warning: " + run.waitingFor(now));
    }
  }

  /** The connection broke: messages of the run are lost, so the run is. */
  void disconnected(String reason, long now) {
    if (state == State.RUNNING || state == State.STEPPING || state == State.WORKING) {
      outbox.notice("warning: the run under way is given up with the connection");
    }
    outbox.notice("lost the broker: " + reason + "; trying again");
    early.clear();
    leavingTo = null;
    free(now);
    forgetPresence();
    offline = true;
  }

  /** The connection is there again, and no other server has the ID. */
  void connected(String stamp) {
    offline = false;
    publishPresence(stamp);
  }
}
