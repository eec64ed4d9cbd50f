"""What the contrast of coded fringes says: model, words, blur, the camera's curve."""
