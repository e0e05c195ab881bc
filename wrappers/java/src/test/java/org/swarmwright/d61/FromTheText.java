package org.swarmwright.d61;

import org.eclipse.paho.client.mqttv3.MqttMessage;
import org.swarmwright.SimulationWrapper;
import org.swarmwright.messages.Actuator;
import org.swarmwright.messages.Control;
import org.swarmwright.messages.Parameters;
import org.swarmwright.messages.Server;

/**
 * The implementing simulation server of D6.1, written from its sections 7.2.2 and 7.2.3 alone:
 * every name and parameter below is in the text, the misprint too.
 */
@SuppressWarnings("deprecation")
public class FromTheText extends SimulationWrapper {
  int handled;

  public FromTheText(Server serverInfo) {
    setServerInfo(serverInfo);
    setAvailalble(true);
  }

  @Override
  public void handleParametersContent(Parameters parameters) {
    handled++;
  }

  @Override
  public void handleControlContent(Control control) {
    setAvailalble(!control.getRun());
    handled++;
  }

  @Override
  public void handleActuatorContent(Actuator actuator) {
    handled++;
  }

  // Section 7.2.3 has the implementing class contain these three.

  @Override
  public void parseParameters(MqttMessage message) {
    super.parseParameters(message);
  }

  @Override
  public void parseControl(MqttMessage message) {
    super.parseControl(message);
  }

  @Override
  public void parseActuator(MqttMessage message) {
    super.parseActuator(message);
  }

  @Override
  public void parseDiscovery(MqttMessage message) {
    super.parseDiscovery(message);
  }

  @Override
  public void messageArrived(String topic, MqttMessage message) throws Exception {
    super.messageArrived(topic, message);
  }
}
