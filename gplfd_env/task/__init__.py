"""An episode: observation, stages, success and failure, reward, disturbances."""
