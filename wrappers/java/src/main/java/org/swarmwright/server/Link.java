package org.swarmwright.server;

import java.nio.ByteBuffer;
import java.nio.charset.StandardCharsets;
import java.util.List;
import java.util.logging.Level;
import java.util.logging.Logger;
import org.eclipse.paho.mqttv5.client.IMqttToken;
import org.eclipse.paho.mqttv5.client.MqttActionListener;
import org.eclipse.paho.mqttv5.client.MqttAsyncClient;
import org.eclipse.paho.mqttv5.client.MqttCallback;
import org.eclipse.paho.mqttv5.client.MqttConnectionOptions;
import org.eclipse.paho.mqttv5.client.MqttDisconnectResponse;
import org.eclipse.paho.mqttv5.client.persist.MemoryPersistence;
import org.eclipse.paho.mqttv5.common.MqttException;
import org.eclipse.paho.mqttv5.common.MqttMessage;
import org.eclipse.paho.mqttv5.common.MqttSubscription;
import org.eclipse.paho.mqttv5.common.packet.MqttProperties;
import org.swarmwright.BrokerException;
import org.swarmwright.mqtt.BrokerAddress;

/** The connection of a server, MQTT 5, which reconnects and subscribes again by itself. */
final class Link {
  private static final Logger LOG = Logger.getLogger(Link.class.getName());
  private static final int TIMEOUT_MILLIS = 10_000;

  /** How long the broker retains the last will, seconds. */
  private static final long WILL_EXPIRY_S = 3600;

  /** Bytes of a packet beside topic, payload and properties: type, lengths of all of these. */
  private static final int HEADER = 8;

  /** Bytes of the properties of a reply: content type and correlation data. */
  private static final int ANSWER_PROPERTIES = 33;

  private final BrokerAddress address;
  private final Client client;
  private final List<MqttSubscription> subscriptions;
  private final Listener listener;

  /** Receives the events of a connection. */
  interface Listener {
    void received(String topic, byte[] payload, boolean retained);

    void connected();

    void disconnected(String reason);
  }

  /**
   * Connects and subscribes.
   *
   * @param will the last will, which the broker publishes, retained, when the connection breaks
   * @throws BrokerException if the broker cannot be reached
   */
  Link(
      BrokerAddress address,
      String name,
      List<MqttSubscription> subscriptions,
      String willTopic,
      byte[] will,
      Listener listener) {
    this.address = address;
    this.subscriptions = subscriptions;
    this.listener = listener;
    MqttConnectionOptions options = new MqttConnectionOptions();
    options.setCleanStart(true);
    options.setAutomaticReconnect(true);
    options.setAutomaticReconnectDelay(1, 5);
    options.setConnectionTimeout(TIMEOUT_MILLIS / 1000);
    options.setKeepAliveInterval(address.keepAlive());
    options.setSocketFactory(address.sockets());
    options.setServerURIs(address.uris());
    if (address.username() != null) {
      options.setUserName(address.username());
    }
    if (address.password() != null) {
      options.setPassword(address.password().getBytes(StandardCharsets.UTF_8));
    }
    MqttProperties expiry = new MqttProperties();
    expiry.setMessageExpiryInterval(WILL_EXPIRY_S);
    options.setWill(willTopic, new MqttMessage(will, 1, true, expiry));
    options.setWillMessageProperties(expiry);
    try {
      client = new Client(address.uri(), name);
      client.setCallback(new Callback());
      client.connect(options).waitForCompletion(TIMEOUT_MILLIS);
      subscribe().waitForCompletion(TIMEOUT_MILLIS);
    } catch (MqttException error) {
      throw new BrokerException(
          "no connection to the broker at "
              + address
              + ": "
              + reason(error)
              + "; "
              + BrokerAddress.advice(error.getCause()),
          error);
    }
  }

  private IMqttToken subscribe() throws MqttException {
    return client.subscribe(subscriptions.toArray(new MqttSubscription[0]));
  }

  private static String reason(MqttException error) {
    Throwable cause = error.getCause() == null ? error : error.getCause();
    return cause.getMessage() == null ? cause.toString() : cause.getMessage();
  }

  /**
   * Publishes with QoS 0; {@code what} names the message in errors.
   *
   * @throws TooLarge if the broker would not take it
   */
  void publish(String label, String topic, byte[] payload) {
    check(label, topic, payload.length);
    send(topic, new MqttMessage(payload, 0, false, null));
  }

  /** Publishes with QoS 1, retained. */
  void retain(String topic, byte[] payload) {
    send(topic, new MqttMessage(payload, 1, true, null));
  }

  /**
   * Publishes a message to a tool with QoS 0; {@code request} is what it answers, null for none.
   *
   * @throws TooLarge if the broker would not take it
   */
  void reply(String topic, Long request, byte[] payload) {
    check("its answer", topic, payload.length + ANSWER_PROPERTIES);
    MqttProperties properties = new MqttProperties();
    properties.setContentType("application/msgpack");
    if (request != null) {
      properties.setCorrelationData(ByteBuffer.allocate(Long.BYTES).putLong(request).array());
    }
    send(topic, new MqttMessage(payload, 0, false, properties));
  }

  /** Brokers close the connection after a packet that is larger than they announced. */
  private void check(String label, String topic, long payload) {
    long bytes = HEADER + topic.getBytes(StandardCharsets.UTF_8).length + payload;
    long max = client.largestPacket();
    if (bytes > max) {
      throw new TooLarge(label, bytes, max);
    }
  }

  /** Without a connection the message is lost; the run to which it belongs is given up anyway. */
  private void send(String topic, MqttMessage message) {
    try {
      client.publish(topic, message);
    } catch (MqttException error) {
      LOG.log(Level.FINE, "a message on {0} is lost", topic);
    }
  }

  /** Sends what was published, then disconnects in order. */
  void close() {
    try {
      client.disconnect(1000).waitForCompletion(2000);
    } catch (MqttException error) {
      quietly(() -> client.disconnectForcibly(0, 500, true));
    }
    quietly(() -> client.close(true));
  }

  private interface Action {
    void run() throws MqttException;
  }

  private static void quietly(Action action) {
    try {
      action.run();
    } catch (MqttException error) {
      LOG.log(Level.FINE, "closing the connection", error);
    }
  }

  /** Paho's client, with access to what the broker announced when it accepted the connection. */
  private static final class Client extends MqttAsyncClient {
    private volatile IMqttToken accepted;

    Client(String uri, String name) throws MqttException {
      super(uri, name, new MemoryPersistence());
    }

    /** Called for every connection, also when Paho reconnects by itself. */
    @Override
    public IMqttToken connect(
        MqttConnectionOptions options, Object context, MqttActionListener listener)
        throws MqttException {
      accepted = super.connect(options, context, listener);
      return accepted;
    }

    /**
     * Bytes of the largest packet that the broker accepts, if it announced a limit. The method of
     * Paho with this name returns the limit of the client.
     */
    long largestPacket() {
      IMqttToken token = accepted;
      MqttProperties announced = token == null ? null : token.getResponseProperties();
      Long max = announced == null ? null : announced.getMaximumPacketSize();
      return max == null ? Long.MAX_VALUE : max;
    }
  }

  private final class Callback implements MqttCallback {
    @Override
    public void messageArrived(String topic, MqttMessage message) {
      listener.received(topic, message.getPayload(), message.isRetained());
    }

    @Override
    public void connectComplete(boolean again, String uri) {
      if (again) {
        // Before anything can come in.
        listener.connected();
        quietly(() -> subscribe());
      }
    }

    @Override
    public void disconnected(MqttDisconnectResponse response) {
      String reason = response.getReasonString();
      if (reason == null && response.getException() != null) {
        reason = reason(response.getException());
      }
      listener.disconnected(reason == null ? "the connection ended" : reason);
    }

    @Override
    public void mqttErrorOccurred(MqttException error) {
      quietly(
          () -> {
            throw error;
          });
    }

    @Override
    public void deliveryComplete(IMqttToken token) {}

    @Override
    public void authPacketArrived(int reasonCode, MqttProperties properties) {}
  }
}
