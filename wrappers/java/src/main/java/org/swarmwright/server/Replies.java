package org.swarmwright.server;

import com.google.gson.JsonObject;
import java.util.List;
import java.util.Map;
import java.util.function.Function;
import java.util.regex.Pattern;
import org.swarmwright.Description;
import org.swarmwright.controllers.Architecture;
import org.swarmwright.controllers.SpecificationException;
import org.swarmwright.extension.Answers;
import org.swarmwright.extension.BatchSensors;
import org.swarmwright.extension.BatchStart;
import org.swarmwright.extension.Evaluate;
import org.swarmwright.extension.Failed;
import org.swarmwright.extension.Failure;
import org.swarmwright.extension.MapReader;
import org.swarmwright.extension.Refusal;
import org.swarmwright.extension.Request;
import org.swarmwright.messages.MessageException;
import org.swarmwright.messages.Topics.Topic;

/** Checks requests of the extensions and sends the replies. */
final class Replies {
  /**
   * Numbers of a reply: fitness and metrics of every episode, in at most half of the largest block;
   * the rest is left for the reasons of failures.
   */
  private static final long MAX_NUMBERS = MapReader.MAX_BLOCK / 8;

  /** Stacks in a message, at most. */
  private static final int MAX_STACKS = 16;

  private static final double MAX_LEASE_S = 1e6;
  private static final Pattern REPLY =
      Pattern.compile(Pattern.quote(Topic.TO_TOOL.text()) + "/[A-Za-z0-9_-]{1,200}");

  private final long server;
  private final Offer offer;
  private final Outbox outbox;
  private final Unread unread;

  /** The specification of the last valid request, which is usually that of the next one. */
  private JsonObject specification;

  private Architecture architecture;

  Replies(long server, Offer offer, Outbox outbox, Unread unread) {
    this.server = server;
    this.offer = offer;
    this.outbox = outbox;
    this.unread = unread;
  }

  /**
   * Whether a reply can be sent to a topic: only to those of tools, so that a request cannot make
   * the server publish on other topics.
   */
  static boolean canReply(String reply) {
    return REPLY.matcher(reply).matches();
  }

  void checkTitle(String title) {
    if (!offer.description().title().equals(title)) {
      throw invalid(
          "simulation: \"" + title + "\" is not offered here, only " + offer.description().title());
    }
  }

  void checkMetrics(List<String> names) {
    List<String> available = offer.description().metrics();
    for (String name : names) {
      if (names.indexOf(name) != names.lastIndexOf(name)) {
        throw invalid("metrics: \"" + name + "\" is named twice");
      }
      if (!available.contains(name)) {
        throw invalid(
            "metrics: \""
                + name
                + "\" is not a metric of "
                + offer.description().title()
                + "; "
                + (available.isEmpty() ? "it has none" : "it has " + String.join(", ", available)));
      }
    }
  }

  /**
   * The job of a request.
   *
   * @throws Refusal if it cannot be done
   */
  Job job(Evaluate request, long now) {
    checkTitle(request.simulation);
    checkMetrics(request.metrics);
    Architecture requested = architecture(request.controller);
    long weights = requested.weightCount();
    if (request.isSample) {
      throw invalid("sample: this server makes no genomes; send them");
    }
    int numbers = request.genomes.length;
    if (numbers % weights != 0) {
      throw invalid(
          "genomes: "
              + numbers
              + " numbers are not a whole number of candidates; the controller has "
              + weights
              + " weights");
    }
    if (numbers / weights * request.seeds.length > MAX_NUMBERS / (2 + request.metrics.size())) {
      throw invalid(
          "genomes: "
              + numbers / weights
              + " candidates in "
              + request.seeds.length
              + " episodes are too many for one answer; send fewer at once");
    }
    boolean limited = request.lease > 0 && request.lease < MAX_LEASE_S;
    return new Job(
        request,
        offer.first(),
        requested,
        unread,
        limited ? (Long) (now + (long) (request.lease * 1e9)) : null);
  }

  private Architecture architecture(JsonObject requested) {
    if (requested.equals(specification)) {
      return architecture;
    }
    Architecture read;
    try {
      read = Architecture.read(requested);
    } catch (SpecificationException error) {
      throw invalid(error.getMessage());
    }
    Description description = offer.description();
    if (read.steers()) {
      check("sensors", read.sensors(), description.sensors());
      check("actuators", read.actuators(), description.actuators());
    }
    specification = requested;
    architecture = read;
    return read;
  }

  private void check(String field, int actual, int expected) {
    if (actual != expected) {
      throw invalid(
          "controller."
              + field
              + ": "
              + actual
              + ", but simulation "
              + offer.description().title()
              + " has "
              + expected);
    }
  }

  private static Refusal invalid(String reason) {
    return new Refusal(Refusal.Kind.INVALID, reason);
  }

  /**
   * Adds a failure to those of a message. Its stack is omitted if a failure with the same reason
   * has one: often many candidates fail in the same line.
   */
  static void addFailure(
      List<Failure> failed, long candidate, long episode, Guard.EpisodeFailed failure) {
    String reason = failure.getMessage();
    boolean isNew =
        failure.stack != null
            && failed.stream().filter(other -> other.stack != null).limit(MAX_STACKS).count()
                < MAX_STACKS
            && failed.stream()
                .noneMatch(other -> other.stack != null && other.reason.equals(reason));
    failed.add(new Failure(candidate, episode, reason, isNew ? failure.stack : null));
  }

  /** Tells a tool that an episode has ended without fitness, if it named a reply topic. */
  void failed(String reply, String hash, String reason, String stack, boolean invalid) {
    if (reply == null || !canReply(reply)) {
      return;
    }
    boolean sent = tell(reply, null, failure(hash, reason, stack, invalid));
    if (!sent && stack != null) {
      tell(reply, null, failure(hash, reason, null, invalid));
    }
  }

  private byte[] failure(String hash, String reason, String stack, boolean invalid) {
    return Answers.failed(new Failed(server, hash, reason, stack, invalid));
  }

  /**
   * Sends a message that says what went wrong. Whether the broker takes it: if not, that is shown
   * and not thrown, so that what follows a failure is done nevertheless.
   */
  private boolean tell(String topic, Long request, byte[] payload) {
    try {
      outbox.reply(topic, request, payload);
      return true;
    } catch (TooLarge error) {
      outbox.notice("warning: " + error.getMessage());
      return false;
    }
  }

  /** Sends the scene of this moment to a tool that asked for scenes. */
  void scene(Run run) throws Guard.EpisodeFailed {
    if (run.reply == null || !canReply(run.reply)) {
      return;
    }
    byte[] scene = run.scene(server);
    if (scene == null) {
      return;
    }
    if (scene.length > MapReader.MAX_BLOCK) {
      throw new Guard.EpisodeFailed(
          "a scene message of "
              + scene.length
              + " bytes is larger than the "
              + MapReader.MAX_BLOCK
              + " allowed",
          true);
    }
    outbox.reply(run.reply, null, scene);
  }

  void send(Job job) {
    byte[] payload =
        job.error != null
            ? refused(job.request.request, job.error)
            : Answers.evaluated(
                job.request.request,
                server,
                job.fitness,
                job.metrics,
                job.failed,
                null,
                job.seconds);
    if (payload.length > MapReader.MAX_BLOCK) {
      String reason =
          "the answer is longer than "
              + MapReader.MAX_BLOCK
              + " bytes; send fewer candidates at once";
      payload = refused(job.request.request, new Refusal(Refusal.Kind.FAILED, reason));
    }
    reply(job.request, payload, refusal -> refused(job.request.request, refusal));
  }

  /** Sends a reply, or a refusal if the broker does not accept a message of that size. */
  private void reply(Request request, byte[] payload, Function<Refusal, byte[]> refused) {
    try {
      outbox.reply(request.reply, request.request, payload);
    } catch (TooLarge error) {
      outbox.notice("warning: " + error.getMessage());
      Refusal refusal = new Refusal(Refusal.Kind.FAILED, error.getMessage());
      tell(request.reply, request.request, refused.apply(refusal));
    }
  }

  void send(BatchStart start, BatchSensors message) {
    byte[] payload = Answers.sensors(message);
    if (payload.length > MapReader.MAX_BLOCK) {
      Refusal refusal =
          invalid(
              "seeds: a step makes a message of "
                  + payload.length
                  + " bytes; start fewer episodes at once");
      payload = Answers.sensors(new BatchSensors(message.request, server, message.step, refusal));
    }
    reply(
        start,
        payload,
        refusal ->
            Answers.sensors(new BatchSensors(message.request, server, message.step, refusal)));
  }

  /** Replies that a request is not served. */
  void refuse(Request request, Refusal refusal) {
    if (request instanceof Evaluate) {
      tell(request.reply, request.request, refused(request.request, refusal));
    } else {
      send((BatchStart) request, new BatchSensors(request.request, server, 0, refusal));
    }
  }

  private byte[] refused(long request, Refusal refusal) {
    return Answers.evaluated(request, server, new double[0], Map.of(), List.of(), refusal, 0);
  }

  /** Replies to a request that is not valid, if its reply topic can be read. */
  void refuseUnread(byte[] payload, String reason) {
    try {
      MapReader map = MapReader.of(payload);
      String kind = map.text("kind");
      String reply = map.text("reply");
      long request = map.bits("request");
      if (!canReply(reply)) {
        return;
      }
      if (kind.equals("evaluate")) {
        tell(reply, request, refused(request, invalid(reason)));
      } else if (kind.equals("start")) {
        tell(
            reply, request, Answers.sensors(new BatchSensors(request, server, 0, invalid(reason))));
      }
    } catch (MessageException error) {
      // Not even the reply topic can be read.
      return;
    }
  }
}
