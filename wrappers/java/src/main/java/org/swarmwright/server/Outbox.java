package org.swarmwright.server;

import org.swarmwright.messages.Topics.Topic;

/** What a server's machine wants done. */
interface Outbox {
  /**
   * Publishes on one of the seven topics.
   *
   * @throws TooLarge if the broker would not take it
   */
  void publish(Topic topic, byte[] payload);

  /** Publishes the server's presence, retained. */
  void presence(byte[] payload);

  /**
   * Publishes the answer to a request, or to none: null; {@code topic} is without prefix.
   *
   * @throws TooLarge if the broker would not take it
   */
  void reply(String topic, Long request, byte[] payload);

  /** Computes, in a thread of its own, and gives the job to {@link Machine#finished}. */
  void evaluate(Job job);

  /** Tells the operator. */
  void notice(String text);

  /** Leaves the broker for good: another server, described in words, has the ID. */
  void giveWay(String rival);

  /** Shows a picture of a run. */
  void show(String picture);
}
