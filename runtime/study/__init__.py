"""Monte Carlo: thousands of closed loops with noise, angles, motors and loads drawn at random; tuning by trial."""
