package org.swarmwright.server;

import com.google.gson.JsonObject;
import java.util.LinkedHashMap;
import java.util.LinkedHashSet;
import java.util.Map;
import java.util.Objects;
import java.util.Set;
import org.swarmwright.messages.Control;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Parameters;

/**
 * Parameters and control messages, which start and end episodes. Times are nanoseconds of {@link
 * System#nanoTime}.
 */
final class RunControl {
  /** Parameters that are kept for a control message to come: few tools ask at once. */
  private static final int MAX_PARAMETERS = 8;

  /** Characters of a title that is not offered, as far as it is quoted. */
  private static final int MAX_QUOTED_TITLE = 200;

  /** Hashes of runs that are remembered, so that each begins once. */
  private static final int MAX_STARTED = 64;

  private final Identity identity;
  private final Offer offer;
  private final Occupancy occupancy;
  private final PresencePublisher presence;
  private final Stepwise stepwise;
  private final Replies replies;
  private final Outbox outbox;
  private final Warnings warnings;
  private final Unread unread;

  /** The last parameters by hash, the newest at the end. */
  private final Map<String, JsonObject> parameters = new LinkedHashMap<>();

  private final EarlyControls early = new EarlyControls();

  private String newestHash;

  /** The last runs of tools that say where to reply, which use a new hash for every run. */
  private final Set<String> started = new LinkedHashSet<>();

  RunControl(
      Identity identity,
      Offer offer,
      Occupancy occupancy,
      PresencePublisher presence,
      Stepwise stepwise,
      Replies replies,
      Outbox outbox,
      Warnings warnings,
      Unread unread) {
    this.identity = identity;
    this.offer = offer;
    this.occupancy = occupancy;
    this.presence = presence;
    this.stepwise = stepwise;
    this.replies = replies;
    this.outbox = outbox;
    this.warnings = warnings;
    this.unread = unread;
  }

  /** A parameters message came in, for this server or another one. */
  void configure(Parameters message, long now) {
    if (message.getServer() != identity.id) {
      occupancy.otherConfigured(message.getSimulationHash(), now);
      return;
    }
    newestHash = message.getSimulationHash();
    parameters.remove(newestHash);
    parameters.put(newestHash, Messages.problem(message));
    if (parameters.size() > MAX_PARAMETERS) {
      parameters.remove(parameters.keySet().iterator().next());
    }
    occupancy.configured(now);
    Control waiting = early.take(newestHash);
    if (waiting != null) {
      receive(waiting, now);
    }
  }

  /** A control message came in, for this server or another one. */
  void receive(Control control, long now) {
    if (control.getServer() != identity.id) {
      return;
    }
    if (!identity.isMeant(control.getInstance())) {
      // That server may be gone: its tool learns of this one by presence.
      if (control.getRun() && occupancy.is(Occupancy.State.FREE) && isOffered(control)) {
        warnings.warnOnce(refusing(control) + "it is meant for another server with this id");
        presence.repeat(now);
      }
    } else if (control.getRun()) {
      start(control, now);
    } else {
      end(control, now);
    }
  }

  private void start(Control control, long now) {
    String hash = control.getSimulationHash();
    if (occupancy.is(Occupancy.State.RUNNING) && occupancy.run().hash.equals(hash)) {
      warnings.warnOnce("ignoring a control message that starts a run that is under way");
      return;
    }
    if (occupancy.isActive() || occupancy.isHeldForOther(control.getTool())) {
      warnings.warnOnce(refusing(control) + "taken by " + occupancy.holderInWords());
      presence.repeat(now);
      return;
    }
    if (!isOffered(control)) {
      refuseTitle(control);
      return;
    }
    boolean once = control.getReply() != null;
    if (once && started.contains(hash)) {
      // A duplicate of the message: the tool, which may not know yet that the run is over, would
      // take its sensor messages for those of the first run.
      warnings.warnOnce("ignoring a control message that starts a run a second time");
      return;
    }
    JsonObject values = parameters.get(hash);
    if (values == null) {
      early.keep(control, now);
      return;
    }
    if (once) {
      rememberStarted(hash);
    }
    try {
      occupancy.begin(new Run(offer.first(), values, control, unread), now);
      stepwise.proceed(now);
    } catch (Guard.EpisodeFailed failed) {
      cannotStart(control, failed.getMessage(), failed.stack, failed.invalid, now);
    } catch (IllegalArgumentException error) {
      cannotStart(control, String.valueOf(error.getMessage()), null, true, now);
    }
  }

  private void rememberStarted(String hash) {
    started.add(hash);
    if (started.size() > MAX_STARTED) {
      started.remove(started.iterator().next());
    }
  }

  /** Whether the simulation is offered; a tool that names none means the only one. */
  private boolean isOffered(Control control) {
    return control.getSimulation() == null || offer.offers(control.getSimulation());
  }

  /** A tool that confuses this server with another one asks for a simulation not offered here. */
  private void refuseTitle(Control control) {
    String title = control.getSimulation();
    String reason =
        "simulation: \""
            + title.substring(0, Math.min(title.length(), MAX_QUOTED_TITLE))
            + "\" is not offered here, only "
            + offer.description().title();
    warnings.warnOnce(refusing(control) + reason);
    replies.failed(control.getReply(), control.getSimulationHash(), reason, null, true);
  }

  private static String refusing(Control control) {
    String tool = control.getTool();
    return "refusing to start a run for "
        + (tool == null ? "an optimization tool without a name" : tool)
        + ": ";
  }

  private void cannotStart(
      Control control, String reason, String stack, boolean invalid, long now) {
    outbox.notice("warning: cannot start the run: " + reason);
    replies.failed(control.getReply(), control.getSimulationHash(), reason, stack, invalid);
    if (control.getTool() == null) {
      occupancy.free(now);
    } else {
      occupancy.hold(control.getTool(), now);
    }
  }

  private void end(Control control, long now) {
    early.forget(control);
    if (occupancy.is(Occupancy.State.FREE)) {
      return;
    }
    if (!endsCurrent(control)) {
      warnings.warnOnce("ignoring the end of a run that is not under way");
      return;
    }
    boolean held = occupancy.is(Occupancy.State.HELD);
    occupancy.giveUp(now);
    if (held) {
      presence.changedForLong(now);
    }
  }

  /** Whether a control{run: false} is of the tool that has the server, for what it does now. */
  private boolean endsCurrent(Control control) {
    String hash = control.getSimulationHash();
    String tool = control.getTool();
    switch (occupancy.state()) {
      case RUNNING:
        return occupancy.run().hash.equals(hash) && Objects.equals(occupancy.run().tool, tool);
      case CONFIGURED:
        return hash.equals(newestHash);
      case HELD:
        if (occupancy.isHeldForUnnamed()) {
          boolean isKnown = hash.equals(occupancy.lastHash()) || parameters.containsKey(hash);
          return tool == null && isKnown;
        }
        return occupancy.holder().equals(tool);
      default:
        return tool != null && tool.equals(occupancy.holder());
    }
  }

  /** When {@link #tick} is needed; null for never. */
  Long nextTick() {
    return early.nextTick();
  }

  /** Refuses control messages whose parameters have not come in time. */
  void tick(long now) {
    for (Control late : early.removeLate(now)) {
      warnings.warnOnce(
          refusing(late)
              + "no parameters arrived for its hash within "
              + EarlyControls.MAX_WAIT_NANOS / 1_000_000_000L
              + " s of its control message");
    }
  }

  void disconnected() {
    early.clear();
  }
}
