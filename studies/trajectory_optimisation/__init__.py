"""Which x_T* makes every motion settle, whatever the friction's state?"""
