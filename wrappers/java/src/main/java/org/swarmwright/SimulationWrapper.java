package org.swarmwright;

import java.util.HashSet;
import java.util.Set;
import java.util.UUID;
import java.util.logging.Level;
import java.util.logging.Logger;
import org.eclipse.paho.client.mqttv3.IMqttDeliveryToken;
import org.eclipse.paho.client.mqttv3.MqttAsyncClient;
import org.eclipse.paho.client.mqttv3.MqttCallback;
import org.eclipse.paho.client.mqttv3.MqttCallbackExtended;
import org.eclipse.paho.client.mqttv3.MqttConnectOptions;
import org.eclipse.paho.client.mqttv3.MqttException;
import org.eclipse.paho.client.mqttv3.MqttMessage;
import org.eclipse.paho.client.mqttv3.persist.MemoryPersistence;
import org.swarmwright.messages.Actuator;
import org.swarmwright.messages.Capabilities;
import org.swarmwright.messages.Control;
import org.swarmwright.messages.Discovery;
import org.swarmwright.messages.Fitness;
import org.swarmwright.messages.MessageException;
import org.swarmwright.messages.Messages;
import org.swarmwright.messages.Parameters;
import org.swarmwright.messages.Requirements;
import org.swarmwright.messages.Sensor;
import org.swarmwright.messages.Server;
import org.swarmwright.messages.Topics;
import org.swarmwright.messages.Topics.Topic;
import org.swarmwright.mqtt.BrokerAddress;

/**
 * The base class of simulation servers after section 7.2.2 of D6.1.
 *
 * <p>When it is instantiated, it connects to the broker and subscribes to discovery, parameters,
 * control and actuator. A subclass calls {@link #setServerInfo} and {@link #setAvailable}, handles
 * messages in the three {@code handle} methods, and answers with {@link #publishSensor} and {@link
 * #publishFitness}. It receives messages for this server only, and none before the server's
 * information is set. All methods are called in one thread, Paho's.
 *
 * <p>The broker is the argument of the constructor, else the system property {@code
 * swarmwright.broker}, else the environment variable SWARMWRIGHT_BROKER, else
 * mqtt://localhost:1883; the prefix of topics is the argument of the constructor, else
 * SWARMWRIGHT_PREFIX, else none. To offer a simulation without handling messages, implement {@link
 * Simulation}.
 */
public abstract class SimulationWrapper implements MqttCallback, AutoCloseable {
  private static final Logger LOG = Logger.getLogger(SimulationWrapper.class.getName());
  private static final int MAX_WARNINGS = 1000;

  private final Topics topics;
  private final MqttAsyncClient client;
  private final Set<String> warnings = new HashSet<>();
  private volatile Server serverInfo;
  private volatile boolean available;
  private volatile String hash;

  /**
   * Connects to the configured broker.
   *
   * @throws BrokerException if it cannot be reached
   */
  protected SimulationWrapper() {
    this(Defaults.broker());
  }

  /**
   * Connects to a broker.
   *
   * @param broker its URL, mqtt://HOST:PORT
   * @throws BrokerException if it cannot be reached
   * @throws IllegalArgumentException if the URL or the prefix of the environment cannot be used
   */
  protected SimulationWrapper(String broker) {
    this(broker, Defaults.prefix());
  }

  /**
   * Connects to a broker, with a prefix for all topics, empty for none.
   *
   * @throws BrokerException if it cannot be reached
   * @throws IllegalArgumentException if the URL or the prefix cannot be used
   */
  protected SimulationWrapper(String broker, String prefix) {
    topics = new Topics(prefix);
    BrokerAddress address = BrokerAddress.of(broker);
    try {
      client =
          new MqttAsyncClient(
              address.uri(), "wrapper-" + UUID.randomUUID(), new MemoryPersistence());
      client.setCallback(new Callback());
      client.connect(options(address)).waitForCompletion(10_000);
      subscribe();
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

  private static MqttConnectOptions options(BrokerAddress address) {
    MqttConnectOptions options = new MqttConnectOptions();
    options.setSocketFactory(address.sockets());
    options.setServerURIs(address.uris());
    options.setAutomaticReconnect(true);
    options.setMaxReconnectDelay(5_000);
    options.setConnectionTimeout(10);
    options.setMaxInflight(10_000);
    if (address.username() != null) {
      options.setUserName(address.username());
    }
    if (address.password() != null) {
      options.setPassword(address.password().toCharArray());
    }
    return options;
  }

  private void subscribe() throws MqttException {
    String[] names = {
      topics.name(Topic.DISCOVERY),
      topics.name(Topic.PARAMETERS),
      topics.name(Topic.CONTROL),
      topics.name(Topic.ACTUATOR)
    };
    client.subscribe(names, new int[names.length]);
  }

  private static String reason(MqttException error) {
    return error.getCause() == null ? error.getMessage() : error.getCause().getMessage();
  }

  // Information on the server.

  /**
   * Sets the server's information, with which discovery is answered: server, simulations and
   * capabilities; the hash is filled in.
   */
  public void setServerInfo(Server serverInfo) {
    this.serverInfo = serverInfo;
  }

  /** The server's information; null until it is set. */
  public Server getServerInfo() {
    return serverInfo;
  }

  /**
   * Sets whether the server can run a simulation now; discovery is answered only then. Initially
   * not available.
   */
  public void setAvailable(boolean available) {
    this.available = available;
  }

  /**
   * As {@link #setAvailable}, in the spelling that D6.1 prints.
   *
   * @deprecated a misspelling in D6.1
   */
  @Deprecated
  public void setAvailalble(boolean availalble) {
    setAvailable(availalble);
  }

  /** Whether the server can run a simulation now. */
  public boolean isAvailable() {
    return available;
  }

  // Implemented by simulation servers.

  /**
   * Receives the parameters of a simulation for this server; those of the problem are their values.
   */
  protected abstract void handleParametersContent(Parameters parameters);

  /** Starts or ends a simulation of this server. */
  protected abstract void handleControlContent(Control control);

  /** Receives the actuators of an agent, in the simulation whose parameters came last. */
  protected abstract void handleActuatorContent(Actuator actuator);

  // Received messages.

  /** A message came in: calls the parse method of its topic. */
  @Override
  public void messageArrived(String topic, MqttMessage message) throws Exception {
    Topic name = topics.parse(topic);
    if (name == null || message.isRetained()) {
      return;
    }
    switch (name) {
      case DISCOVERY:
        parseDiscovery(message);
        break;
      case PARAMETERS:
        parseParameters(message);
        break;
      case CONTROL:
        parseControl(message);
        break;
      case ACTUATOR:
        parseActuator(message);
        break;
      default:
        break;
    }
  }

  /** Reads a parameters message and passes it on if it is for this server. */
  protected void parseParameters(MqttMessage message) {
    Parameters parameters = Messages.readParameters(message.getPayload());
    if (isOwn(parameters.getServer())) {
      hash = parameters.getSimulationHash();
      handleParametersContent(parameters);
    }
  }

  /** Reads a control message and passes it on if it is for this server. */
  protected void parseControl(MqttMessage message) {
    Control control = Messages.readControl(message.getPayload());
    if (isOwn(control.getServer())) {
      handleControlContent(control);
    }
  }

  /**
   * Reads an actuator message and passes it on if it is for the simulation whose parameters came
   * last.
   */
  protected void parseActuator(MqttMessage message) {
    Actuator actuator = Messages.readActuator(message.getPayload());
    if (actuator.getSimulationHash().equals(hash)) {
      handleActuatorContent(actuator);
    }
  }

  /**
   * Reads a discovery message and answers it if this server is available, offers the simulation and
   * fulfils the requirements.
   */
  protected void parseDiscovery(MqttMessage message) {
    Discovery discovery = Messages.readDiscovery(message.getPayload());
    Server info = serverInfo;
    if (info != null
        && available
        && info.getSimulations().contains(discovery.getSimulation())
        && fulfils(info, discovery)) {
      publish(
          Topic.SERVER,
          new Server()
              .withServer(info.getServer())
              .withSimulationHash(discovery.getSimulationHash())
              .withSimulations(info.getSimulations())
              .withCapabilities(info.getCapabilities()));
    }
  }

  private boolean isOwn(Long server) {
    Server info = serverInfo;
    return info != null && server.equals(info.getServer());
  }

  private static boolean fulfils(Server info, Discovery discovery) {
    Capabilities offered = info.getCapabilities();
    Requirements required = discovery.getRequirements();
    boolean enough =
        offered.getMaxAgents() == null
            || required.getMaxAgents() == null
            || offered.getMaxAgents() >= required.getMaxAgents();
    return enough && required.getDimensions().equals(offered.getDimensions());
  }

  // Published messages.

  /** Publishes the sensors of an agent. */
  protected void publishSensor(Sensor sensor) {
    publish(Topic.SENSOR, sensor);
  }

  /** Publishes the fitness, which ends a simulation. */
  protected void publishFitness(Fitness fitness) {
    publish(Topic.FITNESS, fitness);
  }

  private void publish(Topic topic, Object message) {
    try {
      client.publish(topics.name(topic), Messages.write(message), 0, false);
    } catch (MqttException error) {
      LOG.log(
          Level.WARNING, "a {0} message is lost: {1}", new Object[] {topic.text(), reason(error)});
    }
  }

  /** The connection broke; Paho connects again by itself. */
  @Override
  public void connectionLost(Throwable cause) {
    LOG.log(
        Level.WARNING, "the connection to the broker broke: {0}; trying again", cause.getMessage());
  }

  /** A message went out. */
  @Override
  public void deliveryComplete(IMqttDeliveryToken token) {}

  /** Disconnects from the broker. */
  @Override
  public void close() {
    try {
      client.disconnectForcibly(0, 1_000, true);
      client.close(true);
    } catch (MqttException error) {
      LOG.log(Level.FINE, "closing the connection", error);
    }
  }

  /**
   * Catches errors in messages and in the simulation, after which Paho would close the connection.
   */
  private final class Callback implements MqttCallbackExtended {
    @Override
    public void connectComplete(boolean again, String uri) {
      if (!again) {
        return;
      }
      try {
        subscribe();
      } catch (MqttException error) {
        LOG.log(Level.WARNING, "cannot subscribe again: {0}", reason(error));
      }
    }

    @Override
    public void messageArrived(String topic, MqttMessage message) {
      try {
        SimulationWrapper.this.messageArrived(topic, message);
      } catch (MessageException error) {
        if (warnings.size() < MAX_WARNINGS && warnings.add(error.getMessage())) {
          LOG.log(
              Level.WARNING,
              "refusing a message on {0}: {1}",
              new Object[] {topic, error.getMessage()});
        }
      } catch (Throwable error) {
        LOG.log(Level.SEVERE, "the simulation failed on a message on " + topic, error);
      }
    }

    @Override
    public void connectionLost(Throwable cause) {
      SimulationWrapper.this.connectionLost(cause);
    }

    @Override
    public void deliveryComplete(IMqttDeliveryToken token) {
      SimulationWrapper.this.deliveryComplete(token);
    }
  }
}
