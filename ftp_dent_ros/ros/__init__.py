"""Between messages and arrays; QoS, parameters and helpers of the nodes."""
