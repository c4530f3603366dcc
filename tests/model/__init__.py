"""What is simulated: inputs."""
