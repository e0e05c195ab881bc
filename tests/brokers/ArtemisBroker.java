import org.apache.activemq.artemis.core.config.impl.ConfigurationImpl;
import org.apache.activemq.artemis.core.server.embedded.EmbeddedActiveMQ;

/** ActiveMQ Artemis on a port of loopback, in memory; files, if any, in FOLDER. */
class ArtemisBroker {
    public static void main(String[] arguments) throws Exception {
        var configuration = new ConfigurationImpl();
        configuration.setBrokerInstance(new java.io.File(arguments[0]));
        configuration.setPersistenceEnabled(false).setSecurityEnabled(false);
        configuration.setMaxDiskUsage(-1); // it would stop taking messages on a disk that is 90 % full
        configuration.addAcceptorConfiguration("mqtt", "tcp://127.0.0.1:" + arguments[1] + "?protocols=MQTT");
        new EmbeddedActiveMQ().setConfiguration(configuration).start();
        Thread.currentThread().join();
    }
}
