// A simulation server of the D6.1 profile, without extensions. Its world is a line: one agent senses its
// position and sets its speed; the closer it ends to 0, the better.
//
//	line-server tcp://localhost:1883 4711
package main

import (
	"encoding/json"
	"fmt"
	"log"
	"math"
	"os"
	"strconv"
	"strings"

	mqtt "github.com/eclipse/paho.mqtt.golang"
)

const steps = 20

// Message is a JSON object; numbers are float64 in it.
type Message map[string]any

// The readers of a message's keys say whether the key is there with the type that the schemas of section 6.2 demand.
// Other messages are not valid in D6.1.

func get[T any](m Message, key string) (T, bool) {
	value, fits := m[key].(T)
	return value, fits
}

func getOr[T any](m Message, key string, missing T) (T, bool) {
	if _, there := m[key]; !there {
		return missing, true
	}
	return get[T](m, key)
}

func integer(m Message, key string) (float64, bool) {
	value, fits := get[float64](m, key)
	return value, fits && value == math.Trunc(value)
}

// Server is one simulation server. parameters are those received last; hash is that of the simulation under way, x
// where its agent is, step how many steps it has made.
type Server struct {
	id         float64
	client     mqtt.Client
	parameters Message
	running    bool
	hash       string
	x          float64
	step       int
}

// Every server that is available and fulfils the requirements answers (5.2.3, 6.2, 7.2.2).
func (s *Server) discovery(m Message) {
	title, fits1 := get[string](m, "simulation")
	hash, fits2 := get[string](m, "simulation_hash")
	requirements, fits3 := get[map[string]any](m, "requirements")
	dimensions, fits4 := get[float64](requirements, "dimensions")
	agents, fits5 := getOr(Message(requirements), "max_agents", 1.0)
	if !(fits1 && fits2 && fits3 && fits4 && fits5) {
		return
	}
	if !s.running && title == "line" && dimensions == 1 && agents <= 1 {
		s.publish("server", Message{
			"server":          s.id,
			"simulation_hash": hash,
			"simulations":     []string{"line"},
			"capabilities":    Message{"dimensions": 1, "max agents": 1},
		})
	}
}

// Published every time before starting a simulation (6.2).
func (s *Server) configure(m Message) {
	server, fits1 := integer(m, "server")
	_, fits2 := get[string](m, "simulation_hash")
	_, fits3 := getOr(m, "start", 5.0)
	if fits1 && fits2 && fits3 && server == s.id {
		s.parameters = m
	}
}

// Starts the simulation with the parameters received earlier, or terminates it (6.2).
func (s *Server) control(m Message) {
	server, fits1 := integer(m, "server")
	hash, fits2 := get[string](m, "simulation_hash")
	run, fits3 := getOr(m, "run", true)
	_, fits4 := getOr(m, "visual", false)
	if !(fits1 && fits2 && fits3 && fits4) || server != s.id {
		return
	}
	if run && !s.running && s.parameters["simulation_hash"] == hash {
		start, _ := getOr(s.parameters, "start", 5.0)
		s.running, s.hash, s.x, s.step = true, hash, start, 0
		s.sense()
	} else if !run && s.running && hash == s.hash {
		s.running = false
	}
}

// Executes the actuator commands of the agent that is addressed (6.2).
func (s *Server) actuator(m Message) {
	hash, fits1 := get[string](m, "simulation_hash")
	agent, fits2 := integer(m, "agent")
	values, fits3 := get[[]any](m, "actuator")
	if !(fits1 && fits2 && fits3) || len(values) == 0 || !s.running || hash != s.hash || agent != 0 {
		return
	}
	speed, fits := values[0].(float64)
	if !fits {
		return
	}
	s.x += speed
	s.step++
	if s.step < steps {
		s.sense()
		return
	}
	// "When the maximum number of simulation steps has been reached" (6.2).
	s.running = false
	s.publish("fitness", Message{"simulation_hash": s.hash, "fitness": -math.Abs(s.x)})
}

func (s *Server) sense() {
	s.publish("sensor", Message{"simulation_hash": s.hash, "agent": 0, "sensor": []float64{s.x}})
}

func (s *Server) publish(topic string, m Message) {
	payload, err := json.Marshal(m)
	if err != nil {
		log.Printf("%s: %v", topic, err)
		return
	}
	s.client.Publish(topic, 0, false, payload)
}

// handled makes a handler of MQTT messages of one of messages. They are called one after the other.
func handled(handle func(Message)) mqtt.MessageHandler {
	return func(_ mqtt.Client, message mqtt.Message) {
		var m Message
		if err := json.Unmarshal(message.Payload(), &m); err == nil && m != nil {
			handle(m)
		}
	}
}

func main() {
	if len(os.Args) != 3 {
		log.Fatal("usage: line-server BROKER ID")
	}
	id, err := strconv.Atoi(os.Args[2])
	if err != nil {
		log.Fatal(err)
	}
	server := &Server{id: float64(id)}
	options := mqtt.NewClientOptions().AddBroker(strings.Replace(os.Args[1], "mqtt://", "tcp://", 1))
	options.SetClientID(fmt.Sprintf("line-server-%d", id))
	options.SetUsername(os.Getenv("SWARMWRIGHT_USERNAME")).SetPassword(os.Getenv("SWARMWRIGHT_PASSWORD"))
	options.SetConnectRetry(true)
	// Again whenever the connection is back.
	options.SetOnConnectHandler(func(client mqtt.Client) {
		client.Subscribe("discovery", 0, handled(server.discovery))
		client.Subscribe("parameters", 0, handled(server.configure))
		client.Subscribe("control", 0, handled(server.control))
		client.Subscribe("actuator", 0, handled(server.actuator))
		fmt.Println("serving")
	})
	server.client = mqtt.NewClient(options)
	if token := server.client.Connect(); token.Wait() && token.Error() != nil {
		log.Fatal(token.Error())
	}
	select {}
}
