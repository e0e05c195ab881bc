package org.swarmwright.server;

import org.swarmwright.messages.Topics.Topic;

/** Carries out what a {@link Machine} decides. */
interface Outbox {
  /**
   * Publishes on one of the topics of D6.1.
   *
   * @throws TooLarge if the broker would not take it
   */
  void publish(Topic topic, byte[] payload);

  /** Publishes the server's presence, retained. */
  void presence(byte[] payload);

  /**
   * Publishes a message to a tool.
   *
   * @param topic without prefix
   * @param request the request that it answers; null for none
   * @throws TooLarge if the broker would not take it
   */
  void reply(String topic, Long request, byte[] payload);

  /** Computes a job in another thread, then passes it to {@link Machine#finished}. */
  void evaluate(Job job);

  /** Shows a line of text to the operator. */
  void notice(String text);

  /** Disconnects for good: another server, described in words, keeps the ID. */
  void giveWay(String rival);

  /** Shows a picture of a run. */
  void show(String picture);
}
