package org.swarmwright.server;

import java.time.Instant;
import java.time.temporal.ChronoUnit;
import java.util.ArrayList;
import java.util.List;
import java.util.concurrent.CountDownLatch;
import java.util.concurrent.ExecutorService;
import java.util.concurrent.Executors;
import java.util.concurrent.ScheduledExecutorService;
import java.util.concurrent.ScheduledFuture;
import java.util.concurrent.ThreadFactory;
import java.util.concurrent.TimeUnit;
import java.util.function.Consumer;
import java.util.function.LongConsumer;
import java.util.function.Supplier;
import org.eclipse.paho.mqttv5.common.MqttSubscription;
import org.swarmwright.BrokerException;
import org.swarmwright.Simulation;
import org.swarmwright.messages.MessageException;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Presence;
import org.swarmwright.messages.Swarmwright;
import org.swarmwright.messages.Topics;
import org.swarmwright.messages.Topics.Topic;
import org.swarmwright.mqtt.BrokerAddress;

/**
 * Runs a {@link Machine}: connection, clock, a thread for evaluations. All events are passed to the
 * machine under one lock.
 *
 * <p>Not part of the public interface, which is {@link org.swarmwright.SimulationServer}.
 */
public final class Host implements AutoCloseable, Link.Listener, Outbox {
  /** How long a server that starts or reconnects listens for another with its ID. */
  private static final long LISTEN_MILLIS = 100;

  /** How long one that reconnects waits for a sign of life of another with its ID. */
  private static final long CONFIRM_MILLIS = 1000;

  /** How long the clock rests after a bug: it would repeat one that is due at once without end. */
  private static final long REST_NANOS = 1_000_000_000L;

  /** How long closing waits for a step under way. */
  private static final long LEAVE_MILLIS = 5000;

  private final Object lock = new Object();
  private final Identity identity;
  private final Topics topics;
  private final Consumer<String> notices;
  private final Consumer<String> pictures;
  private final Machine machine;
  private final Link link;
  private final ScheduledExecutorService clock =
      Executors.newSingleThreadScheduledExecutor(daemon("clock"));
  private final ExecutorService evaluation =
      Executors.newSingleThreadExecutor(daemon("evaluation"));
  private ScheduledFuture<?> alarm;
  private Long alarmAt;

  /** The alarm is not set to an earlier time; null if there was no bug. */
  private Long restsUntil;

  /** Messages that came before it was certain that no other server has the ID; null afterwards. */
  private List<Runnable> deferred = new ArrayList<>();

  /** How often the connection came or went: a scheduled check is for one connection only. */
  private int changes;

  /** Why the server has left by itself; null if it has not. */
  private String leftBecause;

  private Presence rival;

  /** Whether the other server has published its presence just now: it is not only retained. */
  private boolean rivalAlive;

  /** Whether the other server was made to publish its presence again. */
  private boolean rivalAsked;

  private boolean closed;
  private final CountDownLatch end = new CountDownLatch(1);

  /**
   * Connects and offers a simulation.
   *
   * @param only the simulation, or null to have {@code maker} make them
   * @throws BrokerException if the broker cannot be reached
   * @throws IllegalStateException if another server uses the ID
   */
  public Host(
      Simulation only,
      Supplier<? extends Simulation> maker,
      String broker,
      String prefix,
      long id,
      double stepTimeout,
      Consumer<String> notices,
      Consumer<String> pictures) {
    identity = new Identity(id);
    topics = new Topics(prefix);
    this.notices = notices;
    this.pictures = pictures;
    machine =
        new Machine(
            identity, only == null ? Offer.of(maker) : Offer.of(only), topics, stepTimeout, this);
    List<MqttSubscription> subscriptions = new ArrayList<>();
    for (Topic topic : List.of(Topic.DISCOVERY, Topic.PARAMETERS, Topic.CONTROL, Topic.ACTUATOR)) {
      subscriptions.add(new MqttSubscription(topics.name(topic), 0));
    }
    subscriptions.add(new MqttSubscription(topics.name(Topic.TO_SERVER, id), 0));
    subscriptions.add(new MqttSubscription(presenceTopic(), 1));
    link =
        new Link(
            BrokerAddress.of(broker),
            "server-" + id + "-" + identity.instance,
            subscriptions,
            presenceTopic(),
            Messages.write(machine.presence(Presence.State.LOST, stamp())),
            this);
    refuseRival();
    synchronized (lock) {
      machine.publishPresence(stamp());
      List<Runnable> waiting = deferred;
      deferred = null;
      waiting.forEach(Runnable::run);
      watch();
    }
  }

  private static ThreadFactory daemon(String name) {
    return code -> {
      Thread thread = new Thread(code, name);
      thread.setDaemon(true);
      return thread;
    };
  }

  private String presenceTopic() {
    return topics.name(Topic.PRESENCE, identity.id);
  }

  private static String stamp() {
    return Instant.now().truncatedTo(ChronoUnit.SECONDS).toString();
  }

  /** Listens for a moment for a running server with the same ID. */
  private void refuseRival() {
    try {
      Thread.sleep(LISTEN_MILLIS);
    } catch (InterruptedException error) {
      Thread.currentThread().interrupt();
    }
    Presence other;
    synchronized (lock) {
      other = rival;
    }
    if (other != null) {
      // In order, or the last will would declare the server that has the ID lost.
      link.close();
      throw new IllegalStateException(
          "the id "
              + identity.id
              + " is taken by a server on "
              + Identity.words(other.getCapabilities().getSwarmwright())
              + "; choose another with --id (or, if that server is gone"
              + " for good: mosquitto_pub -r -n -t "
              + presenceTopic()
              + ")");
    }
  }

  private boolean isRival(Presence presence) {
    Swarmwright other = presence.getCapabilities().getSwarmwright();
    return presence.getServer() == identity.id
        && presence.getState() != Presence.State.LOST
        && !(other != null && identity.instance.equals(other.getInstance()))
        && !identity.isDead(other);
  }

  // Events.

  @Override
  public void received(String topic, byte[] payload, boolean retained) {
    synchronized (lock) {
      if (closed || leftBecause != null) {
        return;
      }
      if (deferred == null) {
        receive(topic, payload, retained);
      } else if (!topic.equals(presenceTopic())) {
        deferred.add(() -> receive(topic, payload, retained));
      } else if (payload.length > 0) {
        noteRival(payload, retained);
      }
    }
  }

  private void receive(String topic, byte[] payload, boolean retained) {
    turn(
        "a message on " + topic + " was not handled",
        now -> machine.receive(topic, payload, retained, now));
  }

  /**
   * A turn of the machine, which gets the time at which it begins. A bug in this library must not
   * close the connection, as an exception in Paho does, nor end the clock or the evaluations.
   */
  private void turn(String failure, LongConsumer code) {
    long start = System.nanoTime();
    try {
      code.accept(start);
      machine.computed(start, System.nanoTime());
    } catch (RuntimeException bug) {
      restsUntil = System.nanoTime() + REST_NANOS;
      StackTraceElement[] stack = bug.getStackTrace();
      String location = stack.length == 0 ? "" : " at " + stack[0];
      notices.accept("bug: " + failure + ": " + bug + location);
    } finally {
      watch();
    }
  }

  private void noteRival(byte[] payload, boolean retained) {
    try {
      Presence presence = Messages.readPresence(payload);
      if (isRival(presence)) {
        rival = presence;
        rivalAlive |= !retained;
      }
    } catch (MessageException error) {
      notices.accept(
          "warning: refusing a message on " + presenceTopic() + ": " + error.getMessage());
    }
  }

  @Override
  public void connected() {
    synchronized (lock) {
      if (closed) {
        return;
      }
      deferred = new ArrayList<>();
      rival = null;
      rivalAlive = false;
      rivalAsked = false;
      int now = ++changes;
      clock.schedule(() -> returned(now), LISTEN_MILLIS, TimeUnit.MILLISECONDS);
    }
  }

  /**
   * The connection has been back for a moment: by now it is known whether another server has the
   * ID.
   */
  private void returned(int change) {
    synchronized (lock) {
      if (closed || change != changes) {
        return;
      }
      if (rival != null && rivalAlive) {
        giveWay(Identity.words(rival.getCapabilities().getSwarmwright()));
        return;
      }
      if (rival != null && !rivalAsked) {
        // A broker that was restarted may have retained presences of servers that have ended. One
        // that runs contradicts a "lost" by publishing its presence again.
        rivalAsked = true;
        presence(Messages.write(machine.presence(Presence.State.LOST, stamp())));
        clock.schedule(() -> returned(change), CONFIRM_MILLIS, TimeUnit.MILLISECONDS);
        return;
      }
      List<Runnable> waiting = deferred;
      deferred = null;
      turn("the return of the connection was not handled", now -> machine.connected(stamp()));
      waiting.forEach(Runnable::run);
    }
  }

  @Override
  public void disconnected(String reason) {
    synchronized (lock) {
      if (!closed) {
        changes++;
        turn(
            "the loss of the connection was not handled", now -> machine.disconnected(reason, now));
      }
    }
  }

  /** Sets the alarm to the next tick of the machine. */
  private void watch() {
    Long next = machine.nextTick();
    if (next != null && restsUntil != null) {
      next = Math.max(next, restsUntil);
    }
    boolean same = alarmAt != null && next != null && alarmAt <= next;
    if (closed || same || next == null) {
      return;
    }
    if (alarm != null) {
      alarm.cancel(false);
    }
    alarmAt = next;
    alarm = clock.schedule(this::tick, next - System.nanoTime(), TimeUnit.NANOSECONDS);
  }

  private void tick() {
    synchronized (lock) {
      alarmAt = null;
      if (!closed && leftBecause == null) {
        turn("what was due was not done", now -> machine.tick(now, stamp()));
      }
    }
  }

  // Actions of the machine.

  @Override
  public void publish(Topic topic, byte[] payload) {
    link.publish("a " + topic.text() + " message", topics.name(topic), payload);
  }

  @Override
  public void presence(byte[] payload) {
    link.retain(presenceTopic(), payload);
  }

  @Override
  public void reply(String topic, Long request, byte[] payload) {
    link.reply(topics.under(topic), request, payload);
  }

  @Override
  public void evaluate(Job job) {
    evaluation.execute(
        () -> {
          job.run();
          synchronized (lock) {
            turn(
                "an evaluation that was computed was not answered",
                now -> machine.finished(job, now));
          }
        });
  }

  @Override
  public void notice(String text) {
    notices.accept(text);
  }

  @Override
  public void giveWay(String other) {
    if (leftBecause == null) {
      leftBecause =
          "another server has the id "
              + identity.id
              + " too ("
              + other
              + "): this one, which was disconnected, leaves; start it again with another --id";
      // Not here: this may be the connection's own thread.
      clock.execute(this::close);
    }
  }

  @Override
  public void show(String picture) {
    pictures.accept(picture);
  }

  /**
   * Waits until it is closed.
   *
   * @throws IllegalStateException if it has left by itself, since another server has the ID
   */
  public void await() throws InterruptedException {
    end.await();
    if (leftBecause != null) {
      throw new IllegalStateException(leftBecause);
    }
  }

  /**
   * Gives up what is under way, removes the presence and disconnects; after the step under way, but
   * does not wait long for it: a step that has called System.exit never returns. When the program
   * ends before, the broker declares the server lost.
   */
  @Override
  public void close() {
    Thread leaving = daemon("leaving").newThread(this::leave);
    leaving.start();
    if (Thread.holdsLock(lock)) {
      return;
    }
    try {
      leaving.join(LEAVE_MILLIS);
      if (leaving.isAlive()) {
        notices.accept("warning: could not leave in order: a step is still under way");
      }
    } catch (InterruptedException error) {
      Thread.currentThread().interrupt();
    }
  }

  private void leave() {
    synchronized (lock) {
      if (closed) {
        return;
      }
      closed = true;
      turn("what was under way was not given up", machine::free);
      // Otherwise the presence on the broker is that of the other server with the ID.
      if (leftBecause == null) {
        link.retain(presenceTopic(), new byte[0]);
      }
    }
    link.close();
    clock.shutdownNow();
    evaluation.shutdownNow();
    end.countDown();
  }
}
